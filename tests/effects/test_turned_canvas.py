"""Frames of a camera that moves, laid so that the background stands still."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Box
from nlens_video.effects.foreground.reservoir import Reservoir
from nlens_video.effects.foreground.turned_canvas import TurnedCanvas
from nlens_video.scene.camera import Camera
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 320, 180
OBJECT = np.array([0.2, 0.0, -4.0])
FRAME = Box(0, 0, WIDTH, HEIGHT)
LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)


def camera(yaw=0.0, pitch=-0.3, roll=0.0, eye=(0.0, 1.5, 0.0), yfov=0.7):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", (yaw, pitch, roll)).as_matrix()
    pose[:3, 3] = eye
    return Camera.from_yfov(pose, yfov, WIDTH, HEIGHT)


def shown(view, k1=0.0):
    """Roots of light of a smooth scene by the direction of view (H, W, 3)."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x, y = (x - view.cx) / view.fx, (y - view.cy) / view.fy
    if k1:
        far = np.linspace(0.0, 2.0, 20000)
        scale = np.interp(np.hypot(x, y), far * (1 + k1 * far**2), far) / np.hypot(x, y)
        x, y = x * scale, y * scale
    ray = np.stack([x, -y, -np.ones_like(x)], axis=-1) @ view.world_from_camera[:3, :3].T
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    waves = np.stack([np.sin(9 * ray[..., 0]), np.cos(12 * ray[..., 1]), ray[..., 2] ** 2], axis=-1)
    return (0.5 + 0.3 * waves).astype(np.float32)


def picture(view, k1=0.0):
    codes = np.square(shown(view, k1))
    return ArrayPicture(codes, "rgb", LINEAR)


angles = st.floats(-0.25, 0.25)


@settings(max_examples=15, deadline=None)
@given(yaw=angles, nod=angles, roll=st.floats(-0.1, 0.1), k1=st.sampled_from([0.0, -0.1, 0.05]))
def test_frames_of_a_camera_that_turns_show_the_same_at_each_place_of_the_canvas(
    yaw, nod, roll, k1
):
    canvas = TurnedCanvas.towards(OBJECT, camera(), distortion_k1=k1)
    box = Box(canvas.size[0] // 2 - 60, canvas.size[1] // 2 - 40, canvas.size[0] // 2 + 60, 190)
    first = canvas.part(picture(camera(), k1), camera(), box)
    turned = camera(yaw, -0.3 + 0.4 * nod, roll)
    second = canvas.part(picture(turned, k1), turned, box)
    both = ~(np.isnan(first) | np.isnan(second))[..., 0]
    assert both.mean() > 0.2
    np.testing.assert_allclose(first[both], second[both], atol=3e-3)


@settings(max_examples=15, deadline=None)
@given(yaw=angles, roll=st.floats(-0.1, 0.1), k1=st.sampled_from([0.0, -0.1, 0.05]))
def test_what_is_laid_comes_back_to_the_frame(yaw, roll, k1):
    view = camera(yaw, roll=roll)
    canvas = TurnedCanvas.towards(OBJECT, camera(), distortion_k1=k1)
    whole = Box(0, 0, *canvas.size)
    back = canvas.from_part(canvas.part(picture(view, k1), view, whole), whole, view, FRAME)
    known = ~np.isnan(back[..., 0])
    assert known.mean() > 0.5
    np.testing.assert_allclose(back[known], shown(view, k1)[known], atol=5e-3)


def test_the_ground_s_disparity_is_that_for_the_frame_s_camera():
    canvas, moved = TurnedCanvas.towards(OBJECT, camera()), camera(0.05, -0.25, eye=(0.4, 1.6, 0.3))
    for place in ((300.3, 200.8), (340.0, 170.0)):
        x, y = int(place[0]), int(place[1])
        point = canvas.camera.cropped(Box(x, y, x + 1, y + 1)).plane_points(0.0)[0]
        depth = -moved.to_camera(point)[0, 2]
        assert canvas.ground_disparity(place, moved, 0.0) == pytest.approx(1 / depth)


def test_places_of_the_canvas_are_shown_where_it_is_laid_from():
    view, box = camera(0.1, roll=0.05), Box(200, 100, 260, 140)
    canvas = TurnedCanvas.towards(OBJECT, camera(), distortion_k1=-0.1)
    places = np.meshgrid(
        np.arange(box.x0, box.x1, dtype=np.float32), np.arange(box.y0, box.y1, dtype=np.float32)
    )
    columns, rows = canvas.shown((places[0], places[1]), view)
    back = canvas.frame_places(view, Box(0, 0, WIDTH, HEIGHT))
    x, y = np.rint(columns).astype(int), np.rint(rows).astype(int)
    inside = (x > 0) & (x < WIDTH) & (y > 0) & (y < HEIGHT)
    assert inside.mean() > 0.5
    assert np.abs(back[0][y[inside], x[inside]] - places[0][inside]).max() < 1.0
    assert np.abs(back[1][y[inside], x[inside]] - places[1][inside]).max() < 1.0


def test_the_box_of_the_object_is_found_on_the_canvas_and_back():
    view = camera(0.1)
    canvas = TurnedCanvas.towards(OBJECT, camera())
    box = Box(100, 60, 180, 150)
    again = canvas.seen(canvas.reached(box, view), view)
    assert again.intersection(box) == box and again.width < box.width + 20
    away = camera(2.5)
    assert canvas.seen(canvas.reached(box, view), away).empty
    assert np.isnan(canvas.part(picture(away), away, canvas.reached(box, view))).all()


def test_a_camera_that_looks_straight_down_is_laid_as_it_looks():
    view = camera(pitch=-0.5 * np.pi, eye=(OBJECT[0], 3.0, OBJECT[2]))
    canvas = TurnedCanvas.towards(OBJECT, view)
    back = canvas.from_part(
        canvas.part(picture(view), view, Box(0, 0, *canvas.size)), Box(0, 0, *canvas.size), view,
        Box(20, 20, 300, 160),
    )  # fmt: skip
    np.testing.assert_allclose(back, shown(view)[20:160, 20:300], atol=5e-3)


def test_a_zoom_is_laid_too():
    wide, long = camera(), camera(yfov=0.5)
    canvas = TurnedCanvas.towards(OBJECT, wide)
    box = canvas.reached(Box(120, 60, 200, 120), wide)
    first, second = (canvas.part(picture(one), one, box) for one in (wide, long))
    np.testing.assert_allclose(first, second, atol=4e-3)


@pytest.mark.parametrize("missing", [0.0, 0.3, 0.6])
def test_the_median_is_that_of_the_pictures_that_show_a_pixel(missing):
    rng = np.random.default_rng(3)
    pictures = rng.uniform(0.1, 0.9, (9, 20, 30, 3)).astype(np.float32)
    pictures[rng.uniform(size=pictures.shape[:3]) < missing] = np.nan
    kept = Reservoir(most=15)
    for one in pictures:
        kept.add(one)
    found, _ = kept.median()
    shown_by = (~np.isnan(pictures[..., 0])).sum(axis=0)
    assert np.array_equal(kept.shown, shown_by)
    order = np.sort(pictures, axis=0)  # what is not a number comes last
    at = np.maximum(shown_by // 2, 0)
    low = np.take_along_axis(order, np.maximum(at - 1, 0)[None, ..., None], axis=0)[0]
    high = np.take_along_axis(order, at[None, ..., None], axis=0)[0]
    some = shown_by > 0
    assert (found[some] >= np.minimum(low, high)[some] - 1e-3).all()
    assert (found[some] <= np.maximum(low, high)[some] + 1e-3).all()
    assert (kept.agreement(found, np.zeros((20, 30), np.float32)) <= 1.0).all()
