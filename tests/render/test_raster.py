"""The software rasteriser's kernels against their references."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import shading_block as at
from support.rasteriser import (
    NOTHING_AROUND,
    atlas_of,
    drawn,
    random_block,
    resolved,
    surface,
    truth,
)

from nlens_video.native import kernels
from nlens_video.render.software import raster, reference_kernels
from nlens_video.render.software.deferred import resolve_depth


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.4, 2.0, 8.0]))
@settings(max_examples=40)
def test_rasteriser_shows_the_nearest_triangle_even_across_the_near_plane(seed, spread):
    rng = np.random.default_rng(seed)
    positions = rng.normal(0, spread, (18, 3)).astype(np.float32)
    positions[:, 2] -= 2.0
    faces = np.arange(18, dtype=np.int32).reshape(-1, 3)
    ids, disparity, *_ = drawn(positions, faces)
    expected, nearest = truth(positions, faces)
    # A sample on an edge may go either way.
    assert (ids != expected).mean() < 0.003
    same = ids == expected
    np.testing.assert_allclose(disparity[same], nearest[same], rtol=2e-4, atol=1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_triangle_mesh_covers_each_sample_once_without_cracks(seed):
    """Every triangle alone, one by one: counts must be 1 inside the sheet's outline."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.linspace(-3, 3, 9), np.linspace(-3, 3, 9)), -1)
    grid[1:-1, 1:-1] += rng.uniform(-0.3, 0.3, (7, 7, 2))
    positions = np.full((81, 3), -2.0, np.float32)
    positions[:, :2] = np.round(grid.reshape(-1, 2) * 4) / 4  # many edges run through samples
    corner = np.arange(72)[np.arange(72) % 9 < 8].astype(np.int32)
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 9], 1),
         np.stack([corner + 1, corner + 10, corner + 9], 1)]
    )  # fmt: skip
    counts = sum((drawn(positions, face[None])[0] >= 0).astype(int) for face in faces)
    whole = drawn(positions, faces)[0] >= 0
    assert (counts[whole] >= 1).all()
    if not _folded(positions, faces):
        assert set(np.unique(counts[12:84, 2:30])) == {1}


def _folded(positions, faces):
    a, b, c = (positions[faces[:, k], :2].astype(float) for k in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return (turn <= 0).any() and (turn >= 0).any()


def test_rasterised_rows_do_not_depend_on_their_partition():
    rng = np.random.default_rng(5)
    positions = rng.normal(0, 1.5, (60, 3)).astype(np.float32) - np.float32([0, 0, 3])
    faces = np.arange(60, dtype=np.int32).reshape(-1, 3)
    whole = drawn(positions, faces)
    parts = drawn(positions, faces, rows=[(40, 95), (0, 15), (16, 39)])
    np.testing.assert_array_equal(whole[0], parts[0])
    np.testing.assert_array_equal(whole[1], parts[1])


def test_shading_kernel_agrees_with_the_gltf_specification():
    rng = np.random.default_rng(3)
    fields = random_block(rng)
    lamps = np.zeros((3, 16), np.float32)
    toward = rng.normal(size=(3, 3))
    lamps[:, 8:11] = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    lamps[:, :3] = rng.random((3, 3))
    emitted = fields[at.RED : at.RED + 3].copy()
    kernels.light_points(fields, (lamps, 3, *NOTHING_AROUND))
    added = fields[at.RED : at.RED + 3] - emitted
    suns = [(row[8:11].astype(float), row[:3].astype(float)) for row in lamps]
    expected = np.array(
        [reference_kernels.lit_by_directional(surface(fields, i), suns) for i in range(at.WIDTH)]
    ).T
    np.testing.assert_allclose(added, expected, rtol=2e-3, atol=2e-6)


def test_lamp_shades_as_a_sun_of_equal_irradiance():
    rng = np.random.default_rng(4)
    fields = random_block(rng)
    lamp = np.zeros((1, 16), np.float32)
    lamp[0, :3], lamp[0, 4:7], lamp[0, 13] = (5.0, 3.0, 1.0), (0.4, 1.2, -0.3), 1.0
    emitted = fields[at.RED : at.RED + 3].copy()
    kernels.light_points(fields, (lamp, 0, *NOTHING_AROUND))
    added = fields[at.RED : at.RED + 3] - emitted
    for i in range(at.WIDTH):
        here = surface(fields, i)
        offset = lamp[0, 4:7] + here.view * float(fields[at.DISTANCE, i])
        squared = float(offset @ offset)
        suns = [(offset / math.sqrt(squared), lamp[0, :3].astype(float) / squared)]
        np.testing.assert_allclose(
            added[:, i], reference_kernels.lit_by_directional(here, suns), rtol=3e-3, atol=2e-6
        )


MIN_FILTERS = (9728, 9729, 9984, 9985, 9986, 9987)


@pytest.mark.parametrize("wrap", [33071, 33648, 10497])
@pytest.mark.parametrize("least", MIN_FILTERS)
def test_texture_filtering_and_wrapping_agree_with_the_reference(wrap, least):
    rng = np.random.default_rng(least + wrap)
    pixels = rng.integers(0, 256, (12, 20, 4), np.uint8)
    for mag in (9728, 9729):
        atlas = atlas_of(pixels, mag_filter=mag, min_filter=least, wrap=(wrap, wrap))
        uv, got = np.empty((6, 150), np.float32), np.empty((4, 150), np.float32)
        uv[:2] = rng.uniform(-2.5, 3.5, (2, 150))
        uv[2:] = rng.normal(size=(4, 150)) * 10.0 ** rng.uniform(-3, 0, 150)
        kernels.sample_texture(uv, (atlas.texels, atlas.levels, atlas.table), 0, got)
        for (u, v, *along), color in zip(uv.T.astype(float), got.T, strict=True):
            changes = np.array(along[:2]), np.array(along[2:])
            expected = reference_kernels.sample_texture(atlas, 0, (u, v), changes)
            assert color == pytest.approx(expected, abs=2e-4)


def test_mip_levels_are_averaged_in_linear_light():
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[0], pixels[..., 3] = 255, 255
    atlas = atlas_of(pixels)
    smallest = atlas.texels.reshape(-1, 4)[atlas.levels[-1, 0]]
    np.testing.assert_allclose(smallest, [32768, 32768, 32768, 65535], atol=1)


def test_resolved_depth_is_the_mean_on_one_surface_and_the_nearest_of_two():
    rng = np.random.default_rng(9)
    lines, columns = np.indices((4 * 20, 30))
    disparity = (0.5 + 0.004 * columns + 0.0005 * lines).astype(np.float32)  # steep
    disparity[:, 15:] = 0.9 + 0.0001 * rng.random((80, 15))
    disparity[40:60, 5:9] = 0.0
    disparity[rng.random(disparity.shape) < 0.05] = 0.0
    stored = np.zeros((80, 30 + raster.PADDING), np.float32)
    stored[:, :30] = disparity
    depth = np.empty((20, 30), np.float32)
    resolve_depth(stored, 0, 11, 0.4, depth)
    resolve_depth(stored, 11, 20, 0.4, depth)
    np.testing.assert_allclose(depth, resolved(disparity, np.float32(0.4)), rtol=1e-6)
