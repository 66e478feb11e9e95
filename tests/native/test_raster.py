"""Kernels of the object's geometry in C++: every level gives the same bits."""

import numpy as np
import pytest
from support.made_triangles import HEIGHT, WIDTH, empty_samples, made_lens, set_up, shown
from support.native_levels import assert_same_bits

from nlens_video.native import kernels
from nlens_video.render.software import raster


def filled(module, seed):
    shape, spans, _, kept = set_up(module, seed)
    samples = empty_samples()
    module.fill_triangles(kept, 0, 4 * HEIGHT - 1, shape, spans, WIDTH, *samples)
    return shown(samples)


def filled_behind(module, seed):
    shape, spans, planes, kept = set_up(module, seed)
    samples = empty_samples()
    most = np.linspace(0.1, 2.5, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    module.fill_triangles_behind(kept, 0, 4 * HEIGHT - 1, shape, spans, most, planes, *samples)
    return shown(samples)


@pytest.mark.parametrize("seed", range(4))
def test_projection_and_set_up_are_the_same_at_every_level(seed):
    def run(module):
        (points, *_), *made = set_up(module, seed)
        return [points, *made]

    assert_same_bits(run)


@pytest.mark.parametrize("draw", [filled, filled_behind])
@pytest.mark.parametrize("seed", range(4))
def test_drawn_samples_are_the_same_at_every_level(draw, seed):
    assert (draw(kernels, seed)[1] != raster.NOTHING).any()
    assert_same_bits(lambda module: draw(module, seed))


@pytest.mark.parametrize("seed", range(4))
def test_triangles_behind_no_limit_cover_what_filled_ones_do(seed):
    shape, spans, planes, kept = set_up(kernels, seed)
    most = np.full((HEIGHT, WIDTH), np.inf, np.float32)
    for at in range(len(kept)):
        one, other = empty_samples(), empty_samples()
        alone, lines = kept[at : at + 1], (0, 4 * HEIGHT - 1)
        kernels.fill_triangles(alone, *lines, shape, spans, WIDTH, *one)
        kernels.fill_triangles_behind(alone, *lines, shape, spans, most, planes, *other)
        np.testing.assert_array_equal(shown(one)[1], shown(other)[1])
        np.testing.assert_allclose(shown(one)[0], shown(other)[0], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("draw", [filled, filled_behind])
def test_bands_of_lines_are_drawn_as_the_whole_is(draw):
    shape, spans, planes, kept = set_up(kernels, 7)
    most = np.full((HEIGHT, WIDTH), 1.5, np.float32)
    whole, parts = empty_samples(), empty_samples()
    for samples, edges in ((whole, [0, 4 * HEIGHT]), (parts, [0, 20, 21, 70, 4 * HEIGHT])):
        for first, last in zip(edges[:-1], edges[1:], strict=True):
            if draw is filled:
                kernels.fill_triangles(kept, first, last - 1, shape, spans, WIDTH, *samples)
            else:
                kernels.fill_triangles_behind(
                    kept, first, last - 1, shape, spans, most, planes, *samples
                )
    for one, other in zip(shown(whole), shown(parts), strict=True):
        np.testing.assert_array_equal(one, other)


def test_triangle_that_lies_beside_the_picture_on_some_lines_writes_nothing_there():
    """Far to the right of a line no memory is its own, not even to write the same to."""
    points = np.array([[1.0, 1.0, 1.0], [9e8, 24.0, 1.0], [8e8, 24.0, 1.0]])
    positions, faces = np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32)
    shape = (points, positions, faces, made_lens())
    spans, kept = np.array([[4, 4 * HEIGHT - 1]], np.int32), np.zeros(1, np.int32)
    samples = empty_samples()
    kernels.fill_triangles(kept, 0, 4 * HEIGHT - 1, shape, spans, WIDTH, *samples)
    assert (samples[1][8:, :WIDTH] == raster.NOTHING).all()


def test_bounds_and_travel_are_the_same_at_every_level():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(5, 30, 3)) * 0.5 - (0.0, 0.0, 5.0)
    lenses = np.stack([made_lens() * (1.0 + 0.01 * at) for at in range(5)])
    single = points[0].astype(np.float32)
    assert_same_bits(
        lambda module: [
            module.screen_bounds(points[0], lenses[0]),
            module.screen_bounds(single[::2, ::-1], lenses[0]),
            module.travel_bound(points, lenses),
        ]
    )
    assert 0.0 < kernels.travel_bound(points, lenses) < np.inf


def test_nodes_are_the_same_at_every_level():
    rng = np.random.default_rng(0)
    count = 12
    times = np.cumsum(0.1 + rng.random(6))
    values = rng.normal(size=(6 * count, 3, 4))
    tracks = np.array([[at, 3, 4, at % 3, at % 2, 0, 6 * at, 6] for at in range(count)])
    order = np.stack([np.arange(count), np.arange(count) - 1], axis=1)
    matrices = rng.normal(size=(count, 4, 4))

    def run(module):
        local, world = np.ones((count, 10)), np.empty((count, 4, 4))
        module.sample_tracks(float(times[2]) + 0.05, tracks, times, values, local)
        module.multiply_nodes(local, order, matrices, np.arange(count) % 5 == 4, world)
        return local, world

    assert_same_bits(run)
