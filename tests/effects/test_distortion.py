"""Lens distortion of the object, against OpenCV's own model."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from support import shots

from nlens_video.core.box import undistorted_radius
from nlens_video.core.errors import UsageError
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    ObjectLayer,
)
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.distortion_apply import (
    DistortionMap,
    distort,
    distort_defocused,
    distort_shadow,
)
from nlens_video.effects.camera.distortion_measure import measure
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.shadow.apply import Shade, Shadow
from nlens_video.graph.base.view import View
from nlens_video.graph.nodes.camera import overscan_px
from nlens_video.scene.scene import Scene
from nlens_video.video.pixels.picture import ArrayPicture

CAMERA = shots.camera()
FRAME = Box(0, 0, shots.WIDTH, shots.HEIGHT)
BARREL = Distortion(k1=-0.15, k2=0.02, focal_normalized=True)


@given(st.floats(-0.1, 0.3), st.floats(0.0, 0.05), st.floats(0.0, 1.4))
def test_undistorted_radius_inverts_browns_model(k1, k2, r):
    distorted = r * (1 + k1 * r**2 + k2 * r**4)
    assert undistorted_radius(k1, k2, np.array([distorted]))[0] == pytest.approx(r, abs=2e-3)


def test_radius_without_a_preimage_is_infinite():
    assert np.isinf(undistorted_radius(-0.5, 0.0, np.array([1.0])))[0]


def test_distorted_points_agree_with_opencv():
    bend = DistortionMap.of(BARREL, CAMERA)
    matrix = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]])
    x, y = np.array([10.0, 100.0, 300.0, 470.0]), np.array([5.0, 200.0, 140.0, 260.0])
    ideal = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, 1 + 0 * x], axis=1)
    theirs, _ = cv2.projectPoints(
        ideal, np.zeros(3), np.zeros(3), matrix, np.array([-0.15, 0.02, 0, 0])
    )
    ours = np.stack(bend.distorted(x, y), axis=1)
    assert ours == pytest.approx(theirs[:, 0], abs=1e-6)
    back = np.stack(bend.undistorted(*ours.T), axis=1)
    assert back == pytest.approx(np.stack([x, y], axis=1), abs=0.05)


def disc(at, radius=14.0, box=FRAME):
    x, y = np.meshgrid(np.arange(box.x0, box.x1) + 0.5, np.arange(box.y0, box.y1) + 0.5)
    cover = np.clip(radius - np.hypot(x - at[0], y - at[1]) + 0.5, 0, 1).astype(np.float32)
    return BlurredLayer(box=box, rgba=np.repeat(cover[..., None], 4, axis=2))


def middle(layer):
    weight = layer.rgba[..., 3]
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]] + 0.5
    total = weight.sum()
    return (weight * x).sum() / total + layer.box.x0, (weight * y).sum() / total + layer.box.y0


@pytest.mark.parametrize("at", [(60.0, 50.0), (400.0, 220.0), (240.0, 30.0)])
@pytest.mark.parametrize("model", [BARREL, Distortion(k1=0.08), Distortion(k1=-0.12)])
def test_distorted_layer_lies_where_the_model_maps_it(at, model):
    bend = DistortionMap.of(model, CAMERA)
    x, y = bend.distorted(np.array([at[0]]), np.array([at[1]]))
    out = distort(disc(at), bend)
    assert middle(out) == pytest.approx((x[0], y[0]), abs=0.25)
    assert np.hypot(x[0] - at[0], y[0] - at[1]) > 1
    assert 0 <= out.rgba.min() and out.rgba[..., 3].max() <= 1


def square(light, cover=1.0):
    """A flat square in the frame's corner region, with nothing around it."""
    rgba = np.zeros((100, 100, 4), np.float32)
    rgba[10:-10, 10:-10] = (light, light, light, cover)
    return BlurredLayer(box=Box(350, 150, 450, 250), rgba=rgba)


@pytest.mark.parametrize("model", [BARREL, Distortion(k1=0.08), Distortion(k1=-0.12)])
@pytest.mark.parametrize("light", [0.5, 3.0, -0.25])
def test_flat_object_has_no_rim(model, light):
    out = distort(square(light), DistortionMap.of(model, CAMERA)).rgba
    assert out[..., 3].max() == pytest.approx(1.0, abs=1e-6) and out[..., 3].min() >= 0.0
    colour = np.repeat(light * out[..., 3:], 3, axis=2)
    np.testing.assert_allclose(out[..., :3], colour, atol=2e-6)


def test_highlight_leaves_no_dark_ring_on_what_is_beside_it():
    layer = square(0.02)
    layer.rgba[50, 10:-10, :3] = 50.0
    out = distort(layer, DistortionMap.of(BARREL, CAMERA)).rgba
    inside = out[out[..., 3] == 1.0]
    assert inside[..., :3].min() >= np.float32(0.02) and inside[..., :3].max() > 10.0


def test_bounds_of_the_four_neighbours_hold_at_every_place():
    rng = np.random.default_rng(5)
    rgba = rng.normal(size=(90, 70, 4)).astype(np.float32)
    layer = BlurredLayer(box=Box(-20, 160, 50, 250), rgba=rgba)
    bend = DistortionMap.of(BARREL, CAMERA)
    out = distort(layer, bend)
    columns, rows = (np.floor(part).astype(int) for part in bend.remap(out.box, layer.box))
    known = (np.abs(columns) < 200) & (np.abs(rows) < 200)
    padded = np.pad(rgba, ((300, 300), (300, 300), (0, 0)))
    at = [padded[np.where(known, rows, 0) + 300 + i, np.where(known, columns, 0) + 300 + j]
          for i in (0, 1) for j in (0, 1)]  # fmt: skip
    low, high = np.minimum.reduce(at), np.maximum.reduce(at)
    assert ((out.rgba >= low) & (out.rgba <= high))[known].all()
    assert (out.rgba > low).any()


def test_mirror_image_keeps_light_beyond_the_primaries():
    layer = square(-0.25)
    coc = np.ones(layer.rgba.shape[:2], np.float32)
    sharp = ObjectLayer(box=layer.box, rgba=layer.rgba, depth=coc)
    bend = DistortionMap.of(BARREL, CAMERA)
    out = distort_defocused(DefocusedLayer(layer=sharp, coc_px=coc), bend).layer.rgba
    assert out[..., 0].min() == pytest.approx(-0.25)


def test_centre_of_the_frame_does_not_move():
    at = (CAMERA.cx, CAMERA.cy)
    assert middle(distort(disc(at), DistortionMap.of(BARREL, CAMERA))) == pytest.approx(
        at, abs=0.02
    )


def test_barrel_distortion_fills_the_frame_from_the_overscan():
    bend = DistortionMap.of(BARREL, CAMERA)
    assert bend.margin > 3
    assert DistortionMap.of(Distortion(k1=0.1), CAMERA).margin == 0
    wide = FRAME.expanded(bend.margin)
    opaque = BlurredLayer(box=wide, rgba=np.ones((wide.height, wide.width, 4), np.float32))
    out = distort(opaque, bend)
    assert out.box == FRAME and out.rgba.min() == pytest.approx(1.0, abs=1e-4)


def test_distorting_an_object_out_of_view_gives_an_empty_layer():
    far = disc((-400.0, -400.0), box=Box(-420, -420, -380, -380))
    assert distort(far, DistortionMap.of(BARREL, CAMERA)).box.empty


@pytest.mark.parametrize("model", [BARREL, Distortion(k1=0.15, k2=0.02)])
def test_distorting_a_shadow_and_an_image_out_of_view_gives_empty_ones(model):
    bend = DistortionMap.of(model, CAMERA)
    far = Box(-1420, -420, -1380, -380)
    values = np.ones((*far.shape, 4), np.float32)
    shadow = Shadow(box=far, loss=values[..., :3], coc_px=values[..., 0])
    assert distort_shadow(shadow, bend).box.empty
    sharp = ObjectLayer(box=far, rgba=values, depth=values[..., 0])
    image = distort_defocused(DefocusedLayer(layer=sharp, coc_px=values[..., 0]), bend)
    assert image.layer.box.empty


def test_shadow_and_reflection_are_distorted_with_the_object():
    bend = DistortionMap.of(BARREL, CAMERA)
    layer = disc((400.0, 220.0))
    expected = middle(distort(layer, bend))
    coc = np.full(layer.rgba.shape[:2], 3.0, np.float32)
    plain = Shadow(box=FRAME, loss=layer.rgba[..., :3], coc_px=coc)
    shadow = distort_shadow(replace(plain, shade=lambda: Shade(plain, 0.4)), bend)
    np.testing.assert_array_equal(shadow.shade().shadow.loss, shadow.loss)
    loss = BlurredLayer(box=shadow.box, rgba=np.dstack([shadow.loss, shadow.loss[..., :1]]))
    assert middle(loss) == pytest.approx(expected, abs=0.05)
    assert shadow.coc_px == pytest.approx(3.0)
    sharp = ObjectLayer(box=FRAME, rgba=layer.rgba, depth=coc)
    image = distort_defocused(DefocusedLayer(layer=sharp, coc_px=coc), bend)
    moved = BlurredLayer(box=image.layer.box, rgba=image.layer.rgba)
    assert middle(moved) == pytest.approx(expected, abs=0.05)


def test_strong_distortion_is_refused_where_it_is_given_and_simulated_where_measured(tmp_path):
    scene, view = Scene.load(shots.cube_glb(tmp_path / "cube.glb")), View(width=96, height=64)

    def found(model):
        return {
            "distortion": Measurement(
                effect="distortion", value=20.0, threshold=3.0, unit="px", evidence="", model=model,
                cost_ms=0.0,
            )
        }  # fmt: skip

    assert overscan_px(scene, view, found(Distortion(k1=-0.37))) >= 0
    with pytest.raises(UsageError, match="corners stay empty"):
        overscan_px(scene, view, found(Distortion(k1=-9.0, focal_normalized=True)))


def test_distortion_depends_on_the_focal_length_of_the_camera():
    longer = replace(CAMERA, fx=2 * CAMERA.fx, fy=2 * CAMERA.fy)
    corner = np.array([0.0]), np.array([0.0])
    near, far = (
        np.hypot(
            *DistortionMap.of(Distortion(k1=-0.1, focal_normalized=True), camera).distorted(*corner)
        )
        for camera in (CAMERA, longer)
    )
    assert near[0] == pytest.approx(4 * far[0], rel=1e-6)


def test_facade_with_curved_storeys_is_not_taken_for_a_lens_that_no_camera_has():
    y, x = np.mgrid[0:600, 0:800].astype(np.float32)
    across, down = (x - 399.5) / 500.0, (y - 299.5) / 500.0
    k1 = -0.2  # beyond -4/27 the corners have no ideal position
    radius = np.hypot(across, down)
    scale = undistorted_radius(k1, 0.0, np.minimum(radius, 0.85).astype(np.float64)) / radius
    storeys = np.where(np.sin(60.0 * down * scale) > 0, 200, 60).astype(np.uint8)
    found = measure([ArrayPicture(np.repeat(storeys[..., None], 3, axis=2), "rgb")])
    assert "bent by -" in found.evidence
    assert not found.called_for and found.model is None
