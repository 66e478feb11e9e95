"""Frames of a camera that rotates, warped into one reference view."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Box
from nlens_video.effects.foreground.frame_sampler import FrameSampler
from nlens_video.effects.foreground.rotation_view import RotationView
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
def test_frames_of_a_rotating_camera_agree_in_the_reference_view(yaw, nod, roll, k1):
    reference = RotationView.looking_at(OBJECT, camera(), distortion_k1=k1)
    box = Box(
        reference.size[0] // 2 - 60, reference.size[1] // 2 - 40, reference.size[0] // 2 + 60, 190
    )
    first = reference.register_box(picture(camera(), k1), camera(), box)
    turned = camera(yaw, -0.3 + 0.4 * nod, roll)
    second = reference.register_box(picture(turned, k1), turned, box)
    both = ~(np.isnan(first) | np.isnan(second))[..., 0]
    assert both.mean() > 0.2
    np.testing.assert_allclose(first[both], second[both], atol=3e-3)


@settings(max_examples=15, deadline=None)
@given(yaw=angles, roll=st.floats(-0.1, 0.1), k1=st.sampled_from([0.0, -0.1, 0.05]))
def test_a_registered_frame_is_warped_back_to_itself(yaw, roll, k1):
    view = camera(yaw, roll=roll)
    reference = RotationView.looking_at(OBJECT, camera(), distortion_k1=k1)
    whole = Box(0, 0, *reference.size)
    back = reference.box_to_frame(
        reference.register_box(picture(view, k1), view, whole), whole, view, FRAME
    )
    known = ~np.isnan(back[..., 0])
    assert known.mean() > 0.5
    np.testing.assert_allclose(back[known], shown(view, k1)[known], atol=5e-3)


def test_the_ground_s_disparity_is_that_for_the_frame_s_camera():
    reference, moved = (
        RotationView.looking_at(OBJECT, camera()),
        camera(0.05, -0.25, eye=(0.4, 1.6, 0.3)),
    )
    for place in ((300.3, 200.8), (340.0, 170.0)):
        x, y = int(place[0]), int(place[1])
        point = reference.camera.cropped(Box(x, y, x + 1, y + 1)).plane_points(0.0)[0]
        depth = -moved.to_camera(point)[0, 2]
        assert reference.ground_disparity(place, moved, 0.0) == pytest.approx(1 / depth)


def test_maps_to_the_frame_and_to_the_reference_view_are_inverse():
    view, box = camera(0.1, roll=0.05), Box(200, 100, 260, 140)
    reference = RotationView.looking_at(OBJECT, camera(), distortion_k1=-0.1)
    pixels = np.meshgrid(
        np.arange(box.x0, box.x1, dtype=np.float32), np.arange(box.y0, box.y1, dtype=np.float32)
    )
    columns, rows = reference.project_to_frame((pixels[0], pixels[1]), view)
    back = reference.map_to_reference(view, Box(0, 0, WIDTH, HEIGHT))
    x, y = np.rint(columns).astype(int), np.rint(rows).astype(int)
    inside = (x > 0) & (x < WIDTH) & (y > 0) & (y < HEIGHT)
    assert inside.mean() > 0.5
    assert np.abs(back[0][y[inside], x[inside]] - pixels[0][inside]).max() < 1.0
    assert np.abs(back[1][y[inside], x[inside]] - pixels[1][inside]).max() < 1.0


def test_a_box_is_found_in_the_reference_view_and_back():
    view = camera(0.1)
    reference = RotationView.looking_at(OBJECT, camera())
    box = Box(100, 60, 180, 150)
    again = reference.box_in_frame(reference.box_in_reference(box, view), view)
    assert again.intersection(box) == box and again.width < box.width + 20
    away = camera(2.5)
    assert reference.box_in_frame(reference.box_in_reference(box, view), away).empty
    assert np.isnan(
        reference.register_box(picture(away), away, reference.box_in_reference(box, view))
    ).all()


def test_a_camera_that_looks_straight_down_is_laid_as_it_looks():
    view = camera(pitch=-0.5 * np.pi, eye=(OBJECT[0], 3.0, OBJECT[2]))
    reference = RotationView.looking_at(OBJECT, view)
    back = reference.box_to_frame(
        reference.register_box(picture(view), view, Box(0, 0, *reference.size)),
        Box(0, 0, *reference.size), view, Box(20, 20, 300, 160),
    )  # fmt: skip
    np.testing.assert_allclose(back, shown(view)[20:160, 20:300], atol=5e-3)


def test_a_zoom_is_laid_too():
    wide, long = camera(), camera(yfov=0.5)
    reference = RotationView.looking_at(OBJECT, wide)
    box = reference.box_in_reference(Box(120, 60, 200, 120), wide)
    first, second = (reference.register_box(picture(one), one, box) for one in (wide, long))
    np.testing.assert_allclose(first, second, atol=4e-3)


@pytest.mark.parametrize("missing", [0.0, 0.3, 0.6])
def test_the_median_is_that_of_the_pictures_that_show_a_pixel(missing):
    rng = np.random.default_rng(3)
    pictures = rng.uniform(0.1, 0.9, (9, 20, 30, 3)).astype(np.float32)
    pictures[rng.uniform(size=pictures.shape[:3]) < missing] = np.nan
    kept = FrameSampler(max_frames=15)
    for one in pictures:
        kept.add(one)
    found, _ = kept.median()
    shown_by = (~np.isnan(pictures[..., 0])).sum(axis=0)
    assert np.array_equal(kept.valid_counts, shown_by)
    order = np.sort(pictures, axis=0)  # what is not a number comes last
    at = np.maximum(shown_by // 2, 0)
    low = np.take_along_axis(order, np.maximum(at - 1, 0)[None, ..., None], axis=0)[0]
    high = np.take_along_axis(order, at[None, ..., None], axis=0)[0]
    some = shown_by > 0
    assert (found[some] >= np.minimum(low, high)[some] - 1e-3).all()
    assert (found[some] <= np.maximum(low, high)[some] + 1e-3).all()
    assert (kept.agreement(found, np.zeros((20, 30), np.float32)) <= 1.0).all()
