import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.textured_ground import camera

from nlens_video.core.layers import CocMap
from nlens_video.stages.whole_ground.patches import (
    CELL_PX,
    PATCH_CELLS,
    PATCH_PX,
    ground_patches,
    patch_middles,
    patch_readings,
    reading_cells,
)


def cells_of(width, height, channels=3, seed=0):
    rng = np.random.default_rng(seed)
    return 1.0 + rng.random((height // CELL_PX, width // CELL_PX, channels), dtype=np.float32)


@given(st.integers(3, 14), st.integers(3, 14))
def test_readings_of_a_patch_are_means_of_its_cells(rows, columns):
    cells = cells_of(CELL_PX * columns, CELL_PX * rows)
    found = patch_readings(cells)
    top, left = ((count - PATCH_CELLS * (count // PATCH_CELLS)) // 2 for count in (rows, columns))
    for row in range(rows // PATCH_CELLS):
        for column in range(columns // PATCH_CELLS):
            down, right = top + PATCH_CELLS * row, left + PATCH_CELLS * column
            part = cells[down : down + PATCH_CELLS, right : right + PATCH_CELLS].reshape(-1, 3)
            mean = part.mean(axis=0, dtype=np.float64)
            mean[1] = np.sqrt(max(mean[1] - mean[0] ** 2, 0.0))
            np.testing.assert_allclose(found[row, column], mean, atol=1e-5)


def test_second_reading_is_the_deviation_of_the_first():
    values = np.random.default_rng(3).random((3, 3, 4))
    cells = np.stack([values.mean(2), np.square(values).mean(2), values.mean(2)], axis=2)
    (((_, deviation, _),),) = patch_readings(cells.astype(np.float32))
    assert deviation == pytest.approx(values.std(), rel=1e-4)


@given(st.integers(PATCH_PX, 1000), st.integers(PATCH_PX, 700))
def test_patches_lie_within_the_picture_side_by_side(width, height):
    for middles, extent in zip(patch_middles(width, height), (width, height), strict=True):
        assert middles[0] >= 0.5 * PATCH_PX and middles[-1] <= extent - 0.5 * PATCH_PX
        assert (np.diff(middles) == PATCH_PX).all()
        # what is left over lies on both sides, in whole cells
        before, after = middles[0] - 0.5 * PATCH_PX, extent - middles[-1] - 0.5 * PATCH_PX
        assert abs(before - after) < 2 * CELL_PX


def test_patches_above_the_horizon_are_left_out():
    seen_by = camera()
    cells = cells_of(seen_by.width, seen_by.height)
    patches = ground_patches(cells, (seen_by.width, seen_by.height), seen_by, 0.0, 1.0)
    x, y = patch_middles(seen_by.width, seen_by.height)
    disparity = seen_by.disparity_at(x, y, 0.0)
    assert len(patches.readings) == len(patches.places) == (disparity > 0.02).sum() > 0
    np.testing.assert_allclose(np.exp(patches.places[:, 0]), disparity[disparity > 0.02], rtol=1e-4)


def test_margin_of_the_cells_is_no_part_of_the_picture():
    seen_by = camera()
    size = seen_by.width, seen_by.height
    cells = cells_of(*size)
    margin = np.pad(cells, ((0, 2), (0, 1), (0, 0)), constant_values=9.0)
    alone, with_margin = (
        ground_patches(one, size, seen_by, 0.0, 1.0).readings for one in (cells, margin)
    )
    assert (alone == with_margin).all()


def test_patches_outside_of_a_region_are_left_out():
    seen_by = camera()
    size = seen_by.width, seen_by.height
    half = ground_patches(
        cells_of(*size), size, seen_by, 0.0, 1.0, lambda x, _: x < 0.5 * seen_by.width
    )
    assert len(half.places) > 0 and (half.places[:, 4] < 0.0).all()


@given(st.floats(0.01, 100.0))
def test_unit_of_the_scene_does_not_count(unit):
    seen_by = camera()
    size, cells = (seen_by.width, seen_by.height), cells_of(seen_by.width, seen_by.height)
    pose = seen_by.world_from_camera.copy()
    pose[:3, 3] *= unit
    larger = type(seen_by)(
        world_from_camera=pose, fx=seen_by.fx, fy=seen_by.fy, cx=seen_by.cx, cy=seen_by.cy,
        width=seen_by.width, height=seen_by.height,
    )  # fmt: skip
    one = ground_patches(cells, size, seen_by, 0.0, 1.3)
    other = ground_patches(cells, size, larger, 0.0, 1.3 / unit)
    np.testing.assert_allclose(one.places, other.places, atol=1e-4)


@given(st.sampled_from([1, 2, 4, 8, 16]), st.integers(1, 4), st.integers(1, 5))
def test_cells_are_means_of_the_maps_whatever_their_size(step, rows, columns):
    shape = CELL_PX * rows // step, CELL_PX * columns // step
    rng = np.random.default_rng(rows)
    coc = 20.0 * rng.random(shape, dtype=np.float32)
    sigma = 0.1 + rng.random(shape, dtype=np.float32)
    cells = reading_cells(CocMap(coc_px=coc, sigma_px=sigma), CELL_PX * columns)
    assert cells.shape == (rows, columns, 3)
    side = CELL_PX // step
    part = np.s_[side * (rows - 1) :, :side]
    expected = np.log1p(coc[part]), np.log1p(coc[part]) ** 2, np.log(sigma[part] / (1 + coc[part]))
    np.testing.assert_allclose(cells[-1, 0], [one.mean() for one in expected], rtol=1e-4, atol=1e-4)


def test_maps_that_cells_do_not_divide_give_none():
    maps = np.ones((20, 30), np.float32)
    assert reading_cells(CocMap(coc_px=maps, sigma_px=maps), 100) is None
