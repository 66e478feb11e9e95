"""Shading kernels in C++: every level of processors gives the same bits."""

import numpy as np
import pytest
from support.native_levels import assert_same_bits
from support.rasteriser import atlas_of, random_block

from nlens_video.native import kernels
from nlens_video.render.base.light_depth import NO_MAPS
from nlens_video.scene import surround

REPEAT, MIRROR, CLAMP = 10497, 33648, 33071


def made_atlas(rng, least, wrap):
    pixels = rng.integers(0, 256, (12, 20, 4), np.uint8)
    made = atlas_of(pixels, min_filter=least, wrap=wrap)
    return made.texels, made.levels, made.table


@pytest.mark.parametrize("least", range(9984, 9988))
@pytest.mark.parametrize("wrap", [(REPEAT, MIRROR), (CLAMP, REPEAT)])
def test_filtered_textures_are_the_same_at_every_level(least, wrap):
    rng = np.random.default_rng(least)
    atlas = made_atlas(rng, least, wrap)
    uv = rng.normal(size=(6, 150)).astype(np.float32)
    uv[2:] *= 10.0 ** rng.uniform(-3, 0, 150).astype(np.float32)
    uv[:, 7], uv[0, 8], uv[2, 9] = np.nan, 1e30, np.inf

    def run(module):
        out = np.empty((4, 150), np.float32)
        module.sample_texture(uv, atlas, 0, out)
        return out

    assert_same_bits(run)


@pytest.mark.parametrize("suns", [0, 2, 4])
@pytest.mark.parametrize("rows, levels", [(0, 0), (9, 0), (9, surround.LEVELS)])
def test_light_on_points_is_the_same_at_every_level(suns, rows, levels):
    rng = np.random.default_rng(suns)
    fields = random_block(rng)
    lamps, ambient = rng.random((4, 16), np.float32), rng.random((rows, 4), np.float32)
    around = rng.random((levels, 18, 18, 4), np.float32)

    def run(module):
        lit = fields.copy()
        module.light_points(lit, (lamps, suns, ambient, around, NO_MAPS))
        return lit

    assert_same_bits(run)


def test_a_surround_is_filtered_as_the_shading_looks_it_up():
    assert kernels.SURROUND_LEVELS == surround.LEVELS
    assert pytest.approx(surround.ROUGHEST) == kernels.SURROUND_ROUGHEST
