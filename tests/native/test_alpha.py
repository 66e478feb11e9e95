"""Alpha, layers and deferred shading in C++: every level gives the same bits."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.made_triangles import HEIGHT, WIDTH, empty_samples, set_up, shown
from support.native_levels import assert_same_bits
from support.rasteriser import atlas_of, layered_block

from nlens_video.native import kernels
from nlens_video.render.base.light_depth import NO_MAPS
from nlens_video.render.base.shader_inputs import MATERIAL_FLOATS, SLOTS
from nlens_video.render.software import raster
from nlens_video.render.software.shading_inputs import CUT, LAYERED, UNLIT
from nlens_video.scene import surround

FLAGS = (0, CUT, UNLIT, LAYERED, LAYERED | CUT)
ROWS = (0, HEIGHT)


def made_paint(rng):
    """Materials with all flags, every second one with textures in all slots."""
    pixels = rng.integers(0, 256, (12, 20, 4), np.uint8)
    atlas = atlas_of(pixels, wrap=(10497, 33648))
    numbers = rng.random((len(FLAGS), MATERIAL_FLOATS), np.float32)
    maps = np.full((len(FLAGS), len(SLOTS)), -1, np.int32)
    maps[::2] = 0
    return numbers, maps, np.array(FLAGS, np.int32), (atlas.texels, atlas.levels, atlas.table)


def made_lights(rng, ambient, levels):
    lamps = rng.random((3, 16), np.float32)
    around = rng.random((levels, 18, 18, 4), np.float32)
    return lamps, 2, rng.random((ambient, 4), np.float32), around, NO_MAPS


def made_scene(module, seed, levels=surround.LEVELS):
    rng = np.random.default_rng(seed)
    shape, spans, planes, kept = set_up(module, seed)
    _, positions, faces, lens = shape
    count = len(positions)
    normals, uv, colors = (rng.normal(size=(count, 4)).astype(np.float32) for _ in range(3))
    material = np.arange(len(faces), dtype=np.int32) % len(FLAGS)
    mesh = (positions, normals, uv, colors, faces, material, planes)
    pinhole = np.delete(lens[:16], slice(9, 12)).astype(np.float32)
    paint, lights = made_paint(rng), made_lights(rng, 9, levels)
    return SimpleNamespace(
        triangles=(shape, spans), kept=kept, shading=(mesh, paint, pinhole, lights)
    )


def cut_out(module, scene, most):
    samples = empty_samples()
    mesh, paint, *_ = scene.shading
    module.cut_out_triangles(
        scene.kept, ROWS, WIDTH, scene.triangles, mesh, paint, most, *samples
    )  # fmt: skip
    return samples


@pytest.mark.parametrize("limited", [False, True])
def test_masked_triangles_are_the_same_at_every_level(limited):
    most = np.full((HEIGHT, WIDTH) if limited else (0, 0), 0.4, np.float32)

    def run(module):
        return shown(cut_out(module, made_scene(module, 1), most))

    found = run(kernels)[1]
    assert (found != raster.NOTHING).any() and (found == raster.NOTHING).any()
    assert_same_bits(run)


def test_limited_masked_triangles_lie_behind_the_limit():
    most = np.full((HEIGHT, WIDTH), 0.4, np.float32)
    disparity, _ = cut_out(kernels, made_scene(kernels, 1), most)
    assert disparity[:, :WIDTH].max() <= np.float32(0.4)


@pytest.mark.parametrize("levels", [0, surround.LEVELS])
def test_shaded_and_blended_light_is_the_same_at_every_level(levels):
    def run(module):
        scene = made_scene(module, 2, levels)
        disparity, ids = cut_out(module, scene, np.zeros((0, 0), np.float32))
        rgba = np.zeros((HEIGHT * WIDTH, 4), np.float32)
        passed, front = np.ones_like(disparity), disparity.copy()
        module.blend_triangles(
            scene.kept[::-1].copy(), ROWS, WIDTH, scene.triangles, scene.shading, disparity,
            (passed, front, rgba),
        )  # fmt: skip
        module.shade_rows(*ROWS, WIDTH, ids, passed, scene.shading, rgba)
        return [rgba, *shown((passed, front))]

    rgba, passed, _ = run(kernels)
    assert (rgba[:, 3] > 0.0).any() and (passed < 1.0).any()
    assert_same_bits(run)


@pytest.mark.parametrize("ambient, levels", [(0, 0), (9, 0), (9, surround.LEVELS)])
def test_light_of_layers_is_the_same_at_every_level(ambient, levels):
    rng = np.random.default_rng(5)
    fields, lights = layered_block(rng), made_lights(rng, ambient, levels)
    numbers, maps, _, atlas = made_paint(rng)
    paint = numbers, maps, np.full(len(FLAGS), LAYERED, np.int32), atlas

    def run(module):
        lit = fields.copy()
        module.light_layers(lit, paint, lights)
        return lit

    assert_same_bits(run)
