"""Apertures that are not round: the fast scatter against its reference, and its invariants."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box
from nlens_video.core.optics import Aperture
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.kernels.scatter.scatter_ref import scatter_ref
from nlens_video.kernels.scatter.shape import contains, outer_radius

SHAPES = {
    "3 blades": Aperture(blades=3, rotation_deg=20.0),
    "5 blades": Aperture(blades=5, rotation_deg=-17.0),
    "6 blades": Aperture(blades=6, rotation_deg=8.0, roundness=0.4),
    "cat's eye": Aperture(cat_eye=0.8),
    "5 blades, cat's eye": Aperture(blades=5, cat_eye=0.5),
}


@pytest.fixture
def drop(tmp_path):
    """An aperture that is a picture with no symmetry: a bright wedge and a dim bar."""
    picture = np.zeros((40, 60), np.uint8)
    picture[4:36, 8:20] = 255
    picture[24:36, 20:56] = 120
    assert cv2.imwrite(str(tmp_path / "wedge.png"), picture)
    return Aperture(image=tmp_path / "wedge.png")


def speck(size, at=None, light=(1.0, 0.5, 0.25)):
    """One opaque pixel."""
    rgba = np.zeros((size, size, 4), np.float32)
    y, x = at or (size // 2, size // 2)
    rgba[y, x] = (*light, 1.0)
    return rgba


def patch(shape, margin, seed=2):
    rng = np.random.default_rng(seed)
    rgba = np.zeros((*shape, 4), np.float32)
    inner = rgba[margin:-margin, margin:-margin]
    inner[..., :3] = rng.random((*inner.shape[:2], 3))
    inner[..., 3] = 1.0
    return rgba


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("coc", [-20.0, 14.0])
def test_fast_and_reference_agree_on_a_patch(shape, coc):
    rgba = patch((62, 70), 22)
    plane = np.full(rgba.shape[:2], coc, np.float32)
    frame = Box(-40, -50, 90, 80)
    fast = scatter(rgba, plane, aperture=SHAPES[shape], frame=frame)
    slow = scatter_ref(rgba, plane, aperture=SHAPES[shape], frame=frame)
    np.testing.assert_allclose(fast, slow, atol=0.03)
    assert np.sqrt(np.mean((fast - slow) ** 2)) < 3e-3


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_fast_and_reference_agree_on_a_ramp_through_focus_of_oblong_pixels(shape):
    rgba = patch((56, 54), 20)
    coc = np.repeat(np.linspace(-12, 12, 56, dtype=np.float32)[:, None], 54, axis=1)
    frame = Box(-200, -100, 420, 290)
    options = {"aperture": SHAPES[shape], "frame": frame, "pixel_aspect": 1.3}
    fast, slow = scatter(rgba, coc, **options), scatter_ref(rgba, coc, **options)
    # a small disc that the barrel cuts stays round, as large as what is left of it
    assert np.sqrt(np.mean((fast - slow) ** 2)) < (1e-2 if SHAPES[shape].cat_eye else 6e-3)


@pytest.mark.slow
@pytest.mark.parametrize("coc", [-9.0, 15.0])
def test_fast_and_reference_agree_for_an_aperture_picture(drop, coc):
    rgba = patch((56, 58), 20)
    plane = np.full(rgba.shape[:2], coc, np.float32)
    fast, slow = scatter(rgba, plane, aperture=drop), scatter_ref(rgba, plane, aperture=drop)
    np.testing.assert_allclose(fast, slow, atol=0.02)
    assert np.sqrt(np.mean((fast - slow) ** 2)) < 2e-3


@pytest.mark.parametrize("shape", SHAPES)
def test_highlight_has_the_shape_of_the_aperture(shape):
    # A bright speck on a dark, wide, evenly defocused object.
    rgba = np.zeros((121, 121, 4), np.float32)
    rgba[..., 3] = 1.0
    rgba[60, 60, :3] = 900.0
    aperture, radius = SHAPES[shape], 14.0
    frame = Box(-100, -80, 140, 160)
    barrel = tuple(
        -aperture.cat_eye * offset / (0.5 * np.hypot(240, 240)) for offset in (40.5, 20.5)
    )
    y, x = (np.mgrid[:121, :121] - 60.0) / radius
    for sign in (-1.0, 1.0):
        plane = np.full((121, 121), sign * 2 * radius, np.float32)
        seen = scatter(rgba, plane, aperture=aperture, frame=frame)[..., 0] > 0.5
        inside = contains(aperture, -sign * x, -sign * y, barrel)
        assert np.count_nonzero(seen != inside) < 0.09 * np.count_nonzero(inside)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("coc", [-2.0, 5.0, -23.0])
def test_scatter_by_an_aperture_shape_keeps_energy(shape, coc):
    rgba = speck(81, light=(40.0, 2.0, 1.0))
    plane = np.full((81, 81), coc, np.float32)
    out = scatter(rgba, plane, aperture=SHAPES[shape], frame=Box(-900, -500, 1020, 580))
    np.testing.assert_allclose(out.sum((0, 1)), rgba.sum((0, 1)), rtol=6e-3)


def test_scatter_by_an_aperture_picture_keeps_energy(drop):
    rgba = speck(81)
    out = scatter(rgba, np.full((81, 81), -17.0, np.float32), aperture=drop)
    np.testing.assert_allclose(out.sum((0, 1)), rgba.sum((0, 1)), rtol=1e-3)


@pytest.mark.parametrize("blades", [3, 5, 8])
def test_aperture_shape_is_rotated_by_180_degrees_in_front_of_the_focus(blades):
    rgba, aperture = patch((61, 61), 20), Aperture(blades=blades, rotation_deg=7.0)
    coc = np.full((61, 61), 17.0, np.float32)
    near = scatter(rgba, coc, aperture=aperture)
    far = scatter(rgba[::-1, ::-1], -coc, aperture=aperture)[::-1, ::-1]
    np.testing.assert_allclose(near, far, atol=2e-5)


def test_cat_eye_clips_the_outer_side_behind_the_focus_and_not_the_centre():
    aperture = Aperture(cat_eye=0.9)
    coc = np.full((61, 61), -24.0, np.float32)
    rgba = speck(61)
    middle = scatter(rgba, coc, aperture=aperture, frame=Box(-400, -400, 461, 461))
    np.testing.assert_allclose(middle, scatter(rgba, coc), atol=3e-3)
    corner = scatter(rgba, coc, aperture=aperture, frame=Box(-940, 0, 61, 61))[..., 3]
    seen = np.flatnonzero(corner.any(axis=0))
    assert seen[0] in (18, 19) and seen[-1] < 36


def test_blades_of_full_roundness_are_a_disc():
    rgba, coc = patch((61, 61), 20), np.full((61, 61), 17.0, np.float32)
    shaped = scatter(rgba, coc, aperture=Aperture(blades=6, roundness=1.0))
    np.testing.assert_allclose(shaped, scatter(rgba, coc), atol=2e-3)


def test_blur_reach_is_that_of_the_farthest_point_of_the_shape():
    triangle = Aperture(blades=3)
    rgba, coc = speck(101), np.full((101, 101), -40.0, np.float32)
    reach = blur_reach(coc, rgba[..., 3], aperture=triangle)
    assert outer_radius(triangle) == pytest.approx(np.sqrt(4 * np.pi / (3 * np.sqrt(3))), rel=1e-3)
    seen = np.flatnonzero(scatter(rgba, coc, aperture=triangle)[..., 3].any(axis=0))
    assert 29 <= seen[-1] - 50 <= reach <= 34


def test_black_aperture_picture_is_refused(tmp_path):
    assert cv2.imwrite(str(tmp_path / "black.png"), np.zeros((8, 8), np.uint8))
    coc = np.full((9, 9), 5.0, np.float32)
    with pytest.raises(InputError, match="black"):
        scatter(speck(9), coc, aperture=Aperture(image=tmp_path / "black.png"))


def test_unreadable_aperture_picture_is_refused(tmp_path):
    (tmp_path / "no.png").write_text("no picture")
    with pytest.raises(InputError, match="no.png"):
        scatter(speck(9), np.ones((9, 9), np.float32), aperture=Aperture(image=tmp_path / "no.png"))
