"""Kernels of depth order in C++: every level gives the same bits."""

import numpy as np
import pytest
from support.native_levels import assert_same_bits

HEIGHT, WIDTH = 37, 45
STEP = (2.0, 4.0, 3.0, 3.0)


def made():
    """Colours, coverage and CoCs of an object with a hole, and a mask of what is near."""
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    alpha = np.clip(16 - np.hypot(y - 18, x - 20), 0, 1).astype(np.float32)
    alpha[15:19, 30:33] = 0.0
    rgba = rng.random((HEIGHT, WIDTH, 4), np.float32) * alpha[..., None]
    rgba[..., 3] = alpha
    near = np.hypot(y - 14, x - 15) < 8
    coc = (0.1 * x + np.where(near, 9.0, 1.0)).astype(np.float32)
    return rgba, alpha, coc, near


def test_steps_rims_and_their_reach_are_the_same_at_every_level():
    _, alpha, coc, _ = made()
    away = np.abs(np.random.default_rng(1).normal(size=coc.shape)).astype(np.float32)

    def run(module):
        reach, split = marks = tuple(np.zeros((2, HEIGHT, WIDTH), np.float32))
        assert module.find_steps(coc, alpha, away, STEP, marks)
        assert module.find_rims(coc, alpha, (coc - 5, away), STEP, marks)
        module.chamfer(reach)
        return reach, split

    assert_same_bits(run)


def test_chamfer_reaches_by_the_distance_from_any_side():
    def run(module):
        reach = np.zeros((21, 31), np.float32)
        reach[10, 15] = 8.0
        module.chamfer(reach)
        y, x = np.indices(reach.shape)
        left = np.maximum(8.0 - np.hypot(y - 10, x - 15), 0.0)
        assert np.abs(reach - left).max() < 0.0451 * 8.0
        assert np.allclose(reach, reach[::-1, ::-1], rtol=0.0, atol=1e-5)
        return [reach]

    assert_same_bits(run)


@pytest.mark.parametrize("channels", [3, 4, 5])
@pytest.mark.parametrize("offset", [(0, 0), (1, 0), (1, 1)])
def test_pyramid_is_the_same_at_every_level(channels, offset):
    rng = np.random.default_rng(channels)
    values = rng.random((HEIGHT, WIDTH, channels), np.float32)
    weight = rng.choice([0.0, 0.25, 1.0], (HEIGHT, WIDTH)).astype(np.float32)
    size = (HEIGHT + offset[0] + 1) // 2, (WIDTH + offset[1] + 1) // 2

    def run(module):
        coarse, kept = np.zeros((*size, channels), np.float32), np.zeros(size, np.float32)
        module.halve(values, weight, offset, coarse, kept)
        fine = values.copy()
        module.raise_level(values, weight, coarse, offset, fine)
        return coarse, kept, fine

    assert_same_bits(run)


def test_parting_layers_is_the_same_at_every_level():
    rgba, alpha, _, near = made()
    filled = np.random.default_rng(2).random((HEIGHT, WIDTH, 5), np.float32)

    def run(module):
        own = np.where(near[..., None], rgba, np.float32(0.0))
        module.take_back_out(own, near, (alpha > 0) & ~near, filled)
        front, back = np.zeros((2, HEIGHT, WIDTH, 4), np.float32)
        module.part_layers(near, rgba, rgba * 2, rgba * 3, front, back)
        return own, front, back

    assert_same_bits(run)


def test_what_the_aperture_sees_is_the_same_at_every_level():
    rgba, alpha, coc, near = made()
    points = np.random.default_rng(3).uniform(-1, 1, (13, 2)).astype(np.float32)
    plate = np.random.default_rng(4).random((HEIGHT + 10, WIDTH + 10, 3), np.float32)
    table = np.linspace(0.0, 0.3, 258, dtype=np.float32)

    def run(module):
        found, laid = np.zeros_like(rgba), rgba.copy()
        shown = near.astype(np.float32), coc
        band, everywhere = (0, HEIGHT), np.ones_like(near)
        module.aperture_covariance(shown, (rgba, -coc), points, 1.2, everywhere, found, band)
        numbers = (5, 5, 1.2, 1.0 / 255.0)
        module.edge_parallax(rgba, plate, (coc, -coc), alpha, table, numbers, laid, band)
        return found, laid

    assert_same_bits(run)


@pytest.mark.parametrize("reach", [1, 4])
def test_gather_is_the_same_at_every_level(reach):
    rgba, alpha, coc, _ = made()
    coc = np.clip(coc - 6.0, -2.0 * reach, 2.0 * reach) * np.float32(0.8)
    coc[alpha == 0] = np.nan
    table = np.stack([np.arange(258) / 32.0, np.linspace(1.0, 0.01, 258)]).astype(np.float32)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    order = np.argsort(np.hypot(y, x), kind="stable")
    places, away = np.stack([y, x], 1)[order].astype(np.int32), np.hypot(y, x)[order]

    def run(module):
        tiles = -(-WIDTH // module.GATHERED_COLUMNS)
        width = tiles * module.GATHERED_COLUMNS + 2 * reach
        planes = np.empty((HEIGHT + 2 * reach, module.GATHERED_PLANES, width), np.float32)
        widest = np.empty((len(planes), tiles + 2), np.float32)
        start = (-reach, -reach, reach)
        module.lay_out(rgba, alpha > 0, coc, table, 32.0, start, planes, widest)
        out = np.empty((HEIGHT, WIDTH, 4), np.float32)
        module.gather(planes, widest, (reach, reach), places, away.astype(np.float32), out)
        assert np.isfinite(out).all() and out.any()
        return planes, widest, out

    assert_same_bits(run)
