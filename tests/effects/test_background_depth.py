"""Depth of the background of a travelling camera, and frames warped by it, against ray tracing."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.rooms import room, room_disparities

from nlens_video.core.layers import Box
from nlens_video.effects.foreground.background import exposure_gain
from nlens_video.effects.foreground.background_depth import BackgroundDepth, PlaneSweep
from nlens_video.effects.foreground.detection import detect, foreground_mask
from nlens_video.effects.foreground.parallax_view import ParallaxView
from nlens_video.effects.foreground.rotation_view import RotationView
from nlens_video.effects.foreground.survey import BackgroundSurvey

OBJECT = np.array([0.0, 0.0, -2.2])
EYES = [np.array([0.04 * step - 0.14, shots.EYE_HEIGHT, 0.01 * step]) for step in range(8)]


def camera(eye):
    pose = shots.camera_pose()
    pose[:3, 3] = eye
    return replace(shots.camera(), world_from_camera=pose)


@pytest.fixture(scope="module")
def reference():
    """Reference view of a room whose depth was estimated while a card walked through it."""
    rotation, sweep = RotationView.looking_at(OBJECT, camera(EYES[0])), PlaneSweep()
    for step, eye in enumerate(EYES):
        picture = room(camera(eye), walker=(0.25 * step - 0.9, 1.8))
        sweep.add(rotation.at_eye(eye).warp_lowres(picture, camera(eye)), eye)
    central = rotation.at_eye(sweep.central_eye)
    lowres = central.camera.resized(*rotation.lowres_size)
    return ParallaxView.from_disparity(central, sweep.disparity(lowres, OBJECT))


def true_disparity(view):
    """1 / depth of the empty room (H, W)."""
    return np.max(room_disparities(view), axis=0)


@pytest.mark.slow
def test_the_depth_of_a_wall_and_of_what_is_in_front_of_it_is_estimated(reference):
    camera_there = reference.depth.camera
    seen = reference.rotation.box_in_reference(
        Box(60, 10, 420, 230), camera(reference.rotation.camera.world_from_camera[:3, 3])
    )
    x, y = (low / full for low, full in zip(reference.lowres_size, reference.size, strict=True))
    at = slice(int(seen.y0 * y), int(seen.y1 * y)), slice(int(seen.x0 * x), int(seen.x1 * x))
    off = np.abs(reference.depth.disparity - true_disparity(camera_there))[at]
    reach = camera_there.fx * np.ptp(EYES, axis=0).max()
    assert np.median(off) * reach < 0.5  # pixels over the whole way
    assert (off * reach < 1.5).mean() > 0.93


@pytest.mark.slow
def test_frames_registered_by_depth_agree(reference):
    first, last = (
        reference.register_lowres(room(camera(eye)), camera(eye)) for eye in (EYES[0], EYES[-1])
    )
    both = ~(np.isnan(first) | np.isnan(last))[..., 0]
    flat = [
        reference.rotation.warp_lowres(room(camera(eye)), camera(eye))
        for eye in (EYES[0], EYES[-1])
    ]
    assert both.mean() > 0.15
    off = np.abs(first - last)[both].max(axis=1)
    assert np.percentile(off, 90) < 0.03
    turned_only = np.abs(flat[0] - flat[1])[both].max(axis=1)
    assert np.nanmean(off) < 0.35 * np.nanmean(turned_only)


@pytest.mark.slow
def test_a_frame_gets_back_its_own_background_and_a_walker_keeps_his_shape(reference):
    survey = BackgroundSurvey(reference.size)
    for step, eye in enumerate(EYES):
        picture = room(camera(eye), walker=(0.25 * step - 0.9, 1.8))
        survey.add(reference.register_lowres(picture, camera(eye)))
    model, view = survey.model(), camera(EYES[-1])
    background = reference.render_background(model, view)
    roots = reference.warp_lowres(room(view, walker=(0.1, 1.8)), view)
    roots = background.normalised(roots, exposure_gain(roots, background.roots))
    (detection,) = detect(foreground_mask(roots, background.roots, background.noise))
    foot = reference.ground_disparity(
        (detection.foot[0] * reference.size[0] / reference.lowres_size[0],
         detection.foot[1] * reference.size[1] / reference.lowres_size[1]), view, 0.0,
    )  # fmt: skip
    depth = -view.to_camera(np.array([[0.1, 0.0, -1.8]]))[0, 2]
    assert 1.0 / foot == pytest.approx(depth, rel=0.03)


@pytest.mark.slow
def test_a_frame_registered_by_depth_is_warped_back_to_itself(reference):
    view, frame = camera(EYES[-1]), Box(100, 40, 380, 220)
    held = reference.box_in_reference(Box(0, 0, shots.WIDTH, shots.HEIGHT), view)
    back = reference.box_to_frame(reference.register_box(room(view), view, held), held, view, frame)
    known = ~np.isnan(back[..., 0])
    assert known.mean() > 0.9
    own = np.sqrt(room(view).linear(frame))
    assert np.percentile(np.abs(back - own)[known], 95) < 0.03
    assert (
        reference.box_in_frame(reference.box_in_reference(frame, view), view)
        .intersection(frame)
        .width
        > 0.9 * 280
    )


def test_what_is_occluded_is_out_of_view():
    view = camera(np.array([0.0, 1.0, 0.0])).resized(120, 80)
    disparity = np.full((80, 120), 0.1, np.float32)
    disparity[20:60, 50:60] = 0.5
    depth = BackgroundDepth(camera=view, disparity=disparity)
    eye = view.world_from_camera[:3, 3] + 0.4 * view.world_from_camera[:3, 0]
    columns, _ = depth.forward_map(eye)
    shift = 0.4 * view.fx
    assert columns[40, 55] == pytest.approx(55 - 0.5 * shift, abs=1e-3)
    assert columns[40, 100] == pytest.approx(100 - 0.1 * shift, abs=1e-3)
    behind = round(55 - 0.4 * shift)  # the wall behind the card, as it is seen from there
    assert columns[40, behind] == np.float32(-1e6)
    (back, _), hidden = depth.inverse_map(eye)
    assert back[40, round(55 - 0.5 * shift)] == pytest.approx(55, abs=0.6)
    uncovered = round(55 - 0.1 * shift)  # the wall that only the other place shows
    assert hidden[40, uncovered] and not hidden[40, 110]


def test_the_map_to_the_own_place_is_the_identity():
    view = camera(EYES[0]).resized(96, 54)
    disparity = np.random.default_rng(1).uniform(0.1, 0.5, (54, 96)).astype(np.float32)
    depth = BackgroundDepth(camera=view, disparity=disparity)
    columns, rows = depth.forward_map(EYES[0])
    x, y = np.meshgrid(np.arange(96), np.arange(54))
    assert np.allclose(columns, x, atol=1e-3) and np.allclose(rows, y, atol=1e-3)


def test_few_frames_are_kept_of_many_and_the_central_eye_is_one_of_theirs():
    sweep = PlaneSweep()
    for step in range(70):
        sweep.add(np.full((2, 2, 3), 0.1, np.float32), np.array([0.1 * step, 0.0, 0.0]))
    assert len(sweep._eyes) == len(sweep._sampler.frames) <= 15
    assert sweep.central_eye[0] == pytest.approx(3.4, abs=0.4)
    assert any(sweep.central_eye is eye for eye in sweep._eyes)


@pytest.mark.slow
def test_pictures_from_one_place_tell_no_depth_and_the_ground_is_taken():
    view, sweep = camera(EYES[0]), PlaneSweep()
    rotation = RotationView.looking_at(OBJECT, view)
    for _ in range(4):
        sweep.add(rotation.warp_lowres(room(view), view), EYES[0])
    lowres = rotation.camera.resized(*rotation.lowres_size)
    found = sweep.disparity(lowres, OBJECT)
    ground = np.maximum(lowres.plane_disparity(0.0), 0.0)
    assert np.allclose(found, cv2.medianBlur(ground.astype(np.float32), 5), atol=1e-6)
