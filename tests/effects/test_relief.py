"""The depth of what a camera that travels sees, and frames laid by it, against a scene by rays."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support import shots
from support.rooms import room, room_disparities

from nlens_video.core.layers import Box
from nlens_video.effects.foreground.background import Survey
from nlens_video.effects.foreground.relief import Relief, Views
from nlens_video.effects.foreground.things import find_things, things_mask
from nlens_video.effects.foreground.travelled_canvas import TravelledCanvas
from nlens_video.effects.foreground.turned_canvas import TurnedCanvas

OBJECT = np.array([0.0, 0.0, -2.2])
EYES = [np.array([0.04 * step - 0.14, shots.EYE_HEIGHT, 0.01 * step]) for step in range(8)]


def camera(eye):
    pose = shots.camera_pose()
    pose[:3, 3] = eye
    return replace(shots.camera(), world_from_camera=pose)


@pytest.fixture(scope="module")
def canvas():
    """That of a room whose depth was learnt, while a card walked through it."""
    turned, views = TurnedCanvas.towards(OBJECT, camera(EYES[0])), Views()
    for step, eye in enumerate(EYES):
        picture = room(camera(eye), walker=(0.25 * step - 0.9, 1.8))
        views.add(turned.from_eye(eye).small(picture, camera(eye)), eye)
    middle = turned.from_eye(views.middle)
    small = middle.camera.resized(*turned.small_size)
    return TravelledCanvas.of(middle, views.disparity(small, OBJECT))


def true_disparity(view):
    """1 / depth of the empty room (H, W)."""
    return np.max(room_disparities(view), axis=0)


@pytest.mark.slow
def test_the_depth_of_a_wall_and_of_what_stands_before_it_is_learnt(canvas):
    camera_there = canvas.relief.camera
    seen = canvas.turned.reached(
        Box(60, 10, 420, 230), camera(canvas.turned.camera.world_from_camera[:3, 3])
    )
    x, y = (small / whole for small, whole in zip(canvas.small_size, canvas.size, strict=True))
    at = slice(int(seen.y0 * y), int(seen.y1 * y)), slice(int(seen.x0 * x), int(seen.x1 * x))
    off = np.abs(canvas.relief.disparity - true_disparity(camera_there))[at]
    reach = camera_there.fx * np.ptp(EYES, axis=0).max()
    assert np.median(off) * reach < 0.5  # pixels over the whole way
    assert (off * reach < 1.5).mean() > 0.93


@pytest.mark.slow
def test_frames_laid_by_depth_show_the_same_at_each_place(canvas):
    first, last = (canvas.still(room(camera(eye)), camera(eye)) for eye in (EYES[0], EYES[-1]))
    both = ~(np.isnan(first) | np.isnan(last))[..., 0]
    flat = [canvas.turned.small(room(camera(eye)), camera(eye)) for eye in (EYES[0], EYES[-1])]
    assert both.mean() > 0.15
    off = np.abs(first - last)[both].max(axis=1)
    assert np.percentile(off, 90) < 0.03
    turned_only = np.abs(flat[0] - flat[1])[both].max(axis=1)
    assert np.nanmean(off) < 0.35 * np.nanmean(turned_only)


@pytest.mark.slow
def test_a_frame_gets_back_its_own_background_and_a_walker_keeps_his_shape(canvas):
    survey = Survey(canvas.size)
    for step, eye in enumerate(EYES):
        picture = room(camera(eye), walker=(0.25 * step - 0.9, 1.8))
        survey.add(canvas.still(picture, camera(eye)))
    small, view = survey.result(), camera(EYES[-1])
    background = canvas.background(small, view)
    roots = background.normalised(canvas.small(room(view, walker=(0.1, 1.8)), view))
    (thing,) = find_things(things_mask(roots, background.roots, background.noise))
    foot = canvas.ground_disparity(
        (thing.foot[0] * canvas.size[0] / canvas.small_size[0],
         thing.foot[1] * canvas.size[1] / canvas.small_size[1]), view, 0.0,
    )  # fmt: skip
    depth = -view.to_camera(np.array([[0.1, 0.0, -1.8]]))[0, 2]
    assert 1.0 / foot == pytest.approx(depth, rel=0.03)


@pytest.mark.slow
def test_what_is_laid_by_depth_comes_back_to_the_frame(canvas):
    view, frame = camera(EYES[-1]), Box(100, 40, 380, 220)
    held = canvas.reached(Box(0, 0, shots.WIDTH, shots.HEIGHT), view)
    back = canvas.from_part(canvas.part(room(view), view, held), held, view, frame)
    known = ~np.isnan(back[..., 0])
    assert known.mean() > 0.9
    own = np.sqrt(room(view).linear(frame))
    assert np.percentile(np.abs(back - own)[known], 95) < 0.03
    assert canvas.seen(canvas.reached(frame, view), view).intersection(frame).width > 0.9 * 280


def test_what_something_nearer_hides_is_laid_nowhere():
    view = camera(np.array([0.0, 1.0, 0.0])).resized(120, 80)
    disparity = np.full((80, 120), 0.1, np.float32)
    disparity[20:60, 50:60] = 0.5
    relief = Relief(camera=view, disparity=disparity)
    eye = view.world_from_camera[:3, 3] + 0.4 * view.world_from_camera[:3, 0]
    columns, _ = relief.laid_from(eye)
    shift = 0.4 * view.fx
    assert columns[40, 55] == pytest.approx(55 - 0.5 * shift, abs=1e-3)
    assert columns[40, 100] == pytest.approx(100 - 0.1 * shift, abs=1e-3)
    behind = round(55 - 0.4 * shift)  # the wall behind the card, as it is seen from there
    assert columns[40, behind] == np.float32(-1e6)
    (back, _), hidden = relief.seen_from(eye)
    assert back[40, round(55 - 0.5 * shift)] == pytest.approx(55, abs=0.6)
    uncovered = round(55 - 0.1 * shift)  # the wall that only the other place shows
    assert hidden[40, uncovered] and not hidden[40, 110]


def test_a_relief_seen_from_its_own_place_is_as_it_is():
    view = camera(EYES[0]).resized(96, 54)
    disparity = np.random.default_rng(1).uniform(0.1, 0.5, (54, 96)).astype(np.float32)
    relief = Relief(camera=view, disparity=disparity)
    columns, rows = relief.laid_from(EYES[0])
    x, y = np.meshgrid(np.arange(96), np.arange(54))
    assert np.allclose(columns, x, atol=1e-3) and np.allclose(rows, y, atol=1e-3)


def test_few_views_are_kept_of_many_and_the_middle_is_one_of_them():
    views = Views()
    for step in range(70):
        views.add(np.full((2, 2, 3), 0.1, np.float32), np.array([0.1 * step, 0.0, 0.0]))
    assert len(views._eyes) == len(views._kept.pictures) <= 15
    assert views.middle[0] == pytest.approx(3.4, abs=0.4)
    assert any(views.middle is eye for eye in views._eyes)


@pytest.mark.slow
def test_pictures_from_one_place_tell_no_depth_and_the_ground_is_taken():
    view, views = camera(EYES[0]), Views()
    turned = TurnedCanvas.towards(OBJECT, view)
    for _ in range(4):
        views.add(turned.small(room(view), view), EYES[0])
    small = turned.camera.resized(*turned.small_size)
    found = views.disparity(small, OBJECT)
    ground = np.maximum(small.plane_disparity(0.0), 0.0)
    assert np.allclose(found, cv2.medianBlur(ground.astype(np.float32), 5), atol=1e-6)
