"""Smooth surfaces mirror the light around: both renderers against the definition in NumPy."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.glb_builder import QUAD_UV, GlbBuilder
from support.quads import camera_at, material, quad, unlit

from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.scene.environment import reduce_environment
from nlens_video.scene.plate_environment import sphere
from nlens_video.scene.scene_light import SceneLight
from nlens_video.scene.surround import mirrored_light

TURNS = [0.0, 0.5, -0.9]  # about the up axis, of a quad that faced the camera [rad]


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    """Every test of this file is one of each renderer."""
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


@pytest.fixture(scope="module")
def light():
    """A sky with a bright and a dark side in one colour each, over dark ground."""
    x, y, z = np.moveaxis(sphere(128)[0], -1, 0)
    sky = np.stack([1.0 + 0.6 * np.sin(5.0 * x), 1.0 + 0.5 * z, 1.2 - 0.5 * np.sin(4.0 * z)], -1)
    return reduce_environment(np.where((y > 0.0)[..., None], sky, 0.2).astype(np.float32))


def drawn(renderer_class, builder, folder, light):
    scene = Scene.load(builder.write(folder / "scene.glb"))
    with renderer_class(scene, SceneLight(0, light)) as renderer:
        layer = renderer.render(0.0, camera_at(1000.0))
    return layer.rgba[32 - layer.box.y0, 32 - layer.box.x0]


def turned(turn):
    """A node turned about the up axis, and where its mirror looks for a far eye on the z axis."""
    node = {"rotation": [0.0, math.sin(turn / 2), 0.0, math.cos(turn / 2)]}
    return node, np.array([math.sin(2.0 * turn), 0.0, math.cos(2.0 * turn)])


def soft(light, toward, normal, roughness):
    """What harmonics tell that is mirrored."""
    pair = [light.irradiance_around(axis) / math.pi for axis in (toward, normal)]
    return (1.0 - roughness) * pair[0] + roughness * pair[1]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.5, 0.8])
def test_white_metal_mirrors_the_filtered_light(renderer_class, tmp_path, light, roughness, turn):
    builder = GlbBuilder()
    pbr = {"metallicFactor": 1.0, "roughnessFactor": roughness}
    node, toward = turned(turn)
    quad(builder, number=material(builder, (1, 1, 1, 1), {}, pbr=pbr), node=node)
    normal = np.array([math.sin(turn), 0.0, math.cos(turn)])
    expected = soft(light, toward, normal, roughness)
    share = min(max((0.6 - roughness) / 0.2, 0.0), 1.0)
    sharp = mirrored_light(light.surround.levels, toward, min(roughness, 0.6))
    expected = expected + share * (sharp - expected)
    found = drawn(renderer_class, builder, tmp_path, light)
    np.testing.assert_allclose(found[:3], expected, rtol=0.02, atol=0.01)


def test_clear_coat_mirrors_the_light_sharply(renderer_class, tmp_path, light):
    found = {}
    for name, coat in (("coated", 1.0), ("bare", 0.0)):
        builder = GlbBuilder()
        extensions = {"KHR_materials_clearcoat": {"clearcoatFactor": coat}}
        extensions["KHR_materials_specular"] = {"specularFactor": 0}
        node, toward = turned(0.5)
        quad(builder, number=material(builder, (0, 0, 0, 1), extensions), node=node)
        found[name] = drawn(renderer_class, builder, tmp_path, light)[:3]
    fresnel = 0.04 + 0.96 * (1.0 - math.cos(0.5)) ** 5
    expected = fresnel * mirrored_light(light.surround.levels, toward, 0.0)
    np.testing.assert_allclose(found["coated"] - found["bare"], expected, rtol=0.02, atol=1e-3)


def test_frosted_glass_shows_the_light_behind_it_blurred(renderer_class, tmp_path, light):
    builder = GlbBuilder()
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_specular": {"specularFactor": 0},
    }
    pbr = {"roughnessFactor": 0.4}
    quad(builder, number=material(builder, (1, 1, 1, 1), extensions, pbr=pbr))
    found = drawn(renderer_class, builder, tmp_path, light)
    assert found[3] == pytest.approx(0.4, abs=2e-3)
    behind = mirrored_light(light.surround.levels, np.array([0.0, 0.0, -1.0]), 0.4)
    np.testing.assert_allclose(found[:3], 0.4 * behind, rtol=0.02, atol=2e-3)


@pytest.mark.parametrize("strength", [0.5, 1.0])
@pytest.mark.parametrize("tilt", ["along", "across"])
def test_brushed_metal_mirrors_the_light_around_along_its_stretch(
    renderer_class, tmp_path, tilt, strength
):
    directions, solid = sphere(256)
    middle = {"along": (math.sin(0.7), 0.0), "across": (0.0, math.sin(0.7))}[tilt]
    patch = directions @ np.array([*middle, math.cos(0.7)]) > math.cos(math.radians(28.0))
    sky = np.where(patch[..., None], 0.7, 0.2).astype(np.float32) * np.ones(3, np.float32)
    light = reduce_environment(sky)
    assert light.lamps == ()
    builder = GlbBuilder()
    extensions = {"KHR_materials_anisotropy": {"anisotropyStrength": strength}}
    pbr = {"metallicFactor": 1.0, "roughnessFactor": 0.2}
    quad(builder, number=material(builder, (1, 1, 1, 1), extensions, pbr=pbr), TEXCOORD_0=QUAD_UV)
    found = drawn(renderer_class, builder, tmp_path, light)[:3]
    lobe = stretched_lobe(directions, 0.04, 0.04 + 0.96 * strength**2) * solid
    expected = (lobe[..., None] * sky).sum((0, 1)) / lobe.sum()
    np.testing.assert_allclose(found, expected, rtol=0.08)


def stretched_lobe(light, narrow, wide):
    """GGX with two alphas, times the cosine, for an eye straight above a surface along x and y."""
    x, y, z = np.moveaxis(light, -1, 0)
    half = light + np.array([0.0, 0.0, 1.0])
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
    hx, hy, hz = np.moveaxis(half, -1, 0)
    spread = ((hx / wide) ** 2 + (hy / narrow) ** 2 + hz**2) ** 2
    masked = 0.5 / (z + np.sqrt((wide * x) ** 2 + (narrow * y) ** 2 + z**2))
    return np.where(z > 1e-3, masked * z / spread, 0.0)


@pytest.mark.parametrize("made", ["plastic", "coat"])
def test_softbox_is_mirrored_evenly_and_as_bright_as_it_is(renderer_class, tmp_path, made):
    sky = np.full((256, 512, 3), 0.02, np.float32)
    sky[96:160, 96:160] = 8.0  # 45 degrees wide, at the horizon, in the middle towards +Z
    sky = np.roll(sky, 256, axis=1)
    light = reduce_environment(sky)
    assert len(light.lamps) > 1
    builder = GlbBuilder()
    coat = {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.05}}
    extensions = {**coat, "KHR_materials_specular": {"specularFactor": 0}}
    pbr = {"roughnessFactor": 0.1 if made == "plastic" else 1.0}
    black = material(builder, (0, 0, 0, 1), extensions if made == "coat" else {}, pbr=pbr)
    quad(builder, number=black, node={})
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    with renderer_class(scene, SceneLight(0, light)) as renderer:
        layer = renderer.render(0.0, camera_at(1000.0))
    inner = layer.rgba[layer.rgba[..., 3] > 0.999][:, :3]
    np.testing.assert_allclose(inner, 0.04 * 8.0, rtol=0.12)


@pytest.mark.parametrize("smooth", [True, False])
def test_map_is_filtered_only_where_something_is_smooth(renderer_class, tmp_path, light, smooth):
    builder = GlbBuilder()
    rough = material(builder, (1, 1, 1, 1), {}, pbr={"roughnessFactor": 0.6})
    quad(builder, number=rough)
    if smooth:
        quad(builder, number=material(builder, (1, 1, 1, 1), {}, pbr={"roughnessFactor": 0.5}))
    else:
        quad(builder, number=unlit(builder))
    # a copy: nothing is filtered before it is asked for
    fresh = replace(light, surround=replace(light.surround))
    drawn(renderer_class, builder, tmp_path, fresh)
    assert ("levels" in vars(fresh.surround)) == smooth
