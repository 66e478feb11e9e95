"""Material extensions of glTF: both renderers against the specification's formulas in NumPy."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.glb_builder import QUAD_UV, GlbBuilder
from support.quads import camera_at, draw, material, quad, unlit

from nlens_video.core.color import transfer
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.reference_kernels import (
    SurfacePoint,
    fibre_share,
    fibres,
    layered,
    passed,
    reflectance,
)
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.scene.illumination import Illumination, hemispheres
from nlens_video.scene.scene_light import SceneLight

NORMAL, VIEW = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
SUNS = [(0.0, 0.0), (0.7, 0.3), (1.2, -2.0)]  # from the axis, and around it [rad]


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    """Every test of this file is one of each renderer."""
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


def toward(sun):
    away, around = sun
    return np.array([
        math.sin(away) * math.cos(around), math.sin(away) * math.sin(around), math.cos(away)
    ])  # fmt: skip


def turned_to(direction):
    """The rotation (x, y, z, w) of a light that shines from there: it shines along its -Z."""
    axis, cosine = np.cross([0, 0, 1], direction), float(direction[2])
    q = np.array([*axis, 1.0 + cosine])
    return (q / np.linalg.norm(q)).tolist()


def seen(renderer_class, builder, tmp_path, sun, strength=3.0):
    """Linear light of the middle of a quad that faces a far camera, under one sun."""
    builder.light(intensity=strength, node={"rotation": turned_to(toward(sun))})
    layer = draw(renderer_class, builder, tmp_path, camera_at(1000.0))
    return layer.rgba[32 - layer.box.y0, 32 - layer.box.x0]


PLASTIC = SurfacePoint(
    normal=NORMAL, view=VIEW, base=np.array([0.7, 0.4, 0.1]), metallic=0.0, roughness=0.4,
    f0=np.full(3, 0.04), specular=1.0,
)  # fmt: skip


def plastic(builder, extensions, **fields):
    pbr = {"roughnessFactor": PLASTIC.roughness}
    color = (*PLASTIC.base, 1)
    return material(builder, color, extensions, pbr=pbr, **fields)


def texel(builder, rgba, **more):
    return {"index": builder.texture(np.array([[rgba]], np.uint8)), **more}


@pytest.mark.parametrize("sun", SUNS)
@pytest.mark.parametrize("ior", [1.0, 1.33, 2.4, 0.0])
def test_ior_sets_the_reflectance_at_normal_incidence(renderer_class, tmp_path, ior, sun):
    builder = GlbBuilder()
    quad(builder, number=plastic(builder, {"KHR_materials_ior": {"ior": ior}}))
    f0 = 1.0 if ior == 0.0 else ((1.0 - ior) / (1.0 + ior)) ** 2
    expected = 3.0 * reflectance(replace(PLASTIC, f0=np.full(3, f0)), toward(sun))
    found = seen(renderer_class, builder, tmp_path, sun)
    np.testing.assert_allclose(found[:3], expected, rtol=5e-3, atol=1e-5)


@pytest.mark.parametrize("textured", [False, True])
@pytest.mark.parametrize("sun", SUNS)
def test_specular_weight_and_colour_scale_the_dielectric_reflection(
    renderer_class, tmp_path, textured, sun
):
    builder = GlbBuilder()
    weight, color, ior = 0.8, np.array([1.0, 0.5, 20.0]), 1.8
    told = {"specularFactor": weight, "specularColorFactor": color.tolist()}
    if textured:
        told["specularTexture"] = texel(builder, [0, 255, 0, 128])
        told["specularColorTexture"] = texel(builder, [255, 128, 255, 10])
        weight *= 128 / 255
        color = color * [1, float(transfer("iec61966-2-1").to_linear(np.array(128 / 255))), 1]
    extensions = {"KHR_materials_specular": told, "KHR_materials_ior": {"ior": ior}}
    quad(builder, number=plastic(builder, extensions), TEXCOORD_0=QUAD_UV)
    # KHR_materials_specular: the clamp comes before the weight.
    f0 = np.minimum(((1.0 - ior) / (1.0 + ior)) ** 2 * color, 1.0) * weight
    expected = 3.0 * reflectance(replace(PLASTIC, f0=f0, specular=weight), toward(sun))
    found = seen(renderer_class, builder, tmp_path, sun)
    np.testing.assert_allclose(found[:3], expected, rtol=5e-3, atol=1e-5)


def test_metals_ignore_specular_and_ior(renderer_class, tmp_path):
    found = []
    for extensions in ({}, {
        "KHR_materials_specular": {"specularFactor": 0.1, "specularColorFactor": [1, 0, 0]},
        "KHR_materials_ior": {"ior": 3.0},
    }):  # fmt: skip
        builder = GlbBuilder()
        pbr = {"metallicFactor": 1.0, "roughnessFactor": 0.5}
        quad(builder, number=material(builder, (0.9, 0.6, 0.3, 1), extensions, pbr=pbr))
        found.append(seen(renderer_class, builder, tmp_path, SUNS[1]))
    np.testing.assert_array_equal(*found)


def test_texture_transform_moves_extension_textures_too(renderer_class, tmp_path):
    builder = GlbBuilder()
    row = np.array([[[255, 255, 255, 0], [255, 255, 255, 255]]], np.uint8)
    moved = {"index": builder.texture(row)}
    moved["extensions"] = {"KHR_texture_transform": {"scale": [0, 1], "offset": [0.75, 0]}}
    told = {"KHR_materials_specular": {"specularTexture": moved}}
    quad(builder, number=plastic(builder, told), TEXCOORD_0=QUAD_UV)
    expected = 3.0 * reflectance(PLASTIC, toward(SUNS[0]))
    np.testing.assert_allclose(
        seen(renderer_class, builder, tmp_path, SUNS[0])[:3], expected, rtol=5e-3
    )


def test_emissive_strength_multiplies_factor_and_texture(renderer_class, tmp_path):
    builder = GlbBuilder()
    glow = {"emissiveFactor": [0.5, 1.0, 0.25], "emissiveTexture": texel(builder, [255, 188, 0])}
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 8.0}}
    black = {"KHR_materials_specular": {"specularFactor": 0}}
    quad(
        builder, number=material(builder, (0, 0, 0, 1), {**strong, **black}, **glow),
        TEXCOORD_0=QUAD_UV,
    )  # fmt: skip
    linear = float(transfer("iec61966-2-1").to_linear(np.array(188 / 255)))
    found = seen(renderer_class, builder, tmp_path, SUNS[1])
    np.testing.assert_allclose(found[:3], [4.0, 8.0 * linear, 0.0], rtol=3e-3)


TURNS = [0.0, 0.5, 1.25]  # of the quad, about x [rad]


def turned_point(surface, turn):
    """The surface turned about x, and the rotation (x, y, z, w) of its node."""
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    vectors = {name: getattr(surface, name) for name in ("normal", "along", "coat_normal")}
    moved = {name: rotation @ v for name, v in vectors.items() if v is not None}
    quaternion = [math.sin(turn / 2), 0, 0, math.cos(turn / 2)]
    return replace(surface, **moved), {"rotation": quaternion}


def assert_as_defined(renderer_class, tmp_path, surface, make, rtol=6e-3):
    """A turned quad of a material under each sun against `layered`; `make` adds the material."""
    for turn in TURNS:
        here, node = turned_point(surface, turn)
        for sun in SUNS:
            builder = GlbBuilder()
            quad(builder, number=make(builder), node=node, TEXCOORD_0=QUAD_UV)
            found = seen(renderer_class, builder, tmp_path, sun)[:3]
            expected = 3.0 * layered(here, toward(sun))
            np.testing.assert_allclose(found, expected, rtol=rtol, atol=2e-4)


@pytest.mark.parametrize("textured", [False, True])
def test_clear_coat_lies_over_the_base(renderer_class, tmp_path, textured):
    def make(builder):
        told = {"clearcoatFactor": 0.9, "clearcoatRoughnessFactor": 0.5}
        if textured:
            told["clearcoatTexture"] = texel(builder, [128, 0, 0])
            told["clearcoatRoughnessTexture"] = texel(builder, [0, 200, 0])
        return plastic(builder, {"KHR_materials_clearcoat": told})

    weight, rough = (128 / 255, 200 / 255) if textured else (1.0, 1.0)
    surface = replace(PLASTIC, coat=0.9 * weight, coat_roughness=0.5 * rough)
    assert_as_defined(renderer_class, tmp_path, surface, make)


def test_normal_maps_of_base_and_clear_coat_are_apart(renderer_class, tmp_path):
    def make(builder):
        told = {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.6}
        told["clearcoatNormalTexture"] = texel(builder, [218, 128, 218])
        told = {"KHR_materials_clearcoat": told}
        return plastic(builder, told, normalTexture=texel(builder, [128, 218, 218]))

    right, up = (np.array([218, 128, 218]) / 127.5 - 1, np.array([128, 218, 218]) / 127.5 - 1)
    surface = replace(
        PLASTIC, normal=up / np.linalg.norm(up), coat_normal=right / np.linalg.norm(right),
        coat=1.0, coat_roughness=0.6,
    )  # fmt: skip
    assert_as_defined(renderer_class, tmp_path, surface, make, rtol=2e-2)


def test_clear_coat_darkens_emission(renderer_class, tmp_path):
    builder = GlbBuilder()
    told = {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0}}
    told["KHR_materials_specular"] = {"specularFactor": 0}
    quad(builder, number=material(builder, (0, 0, 0, 1), told, emissiveFactor=[1, 1, 1]))
    found = seen(renderer_class, builder, tmp_path, (3.1, 0.0))
    np.testing.assert_allclose(found[:3], 0.96, rtol=2e-3)


@pytest.mark.parametrize("textured", [False, True])
def test_sheen_of_fibres_is_added_and_takes_from_the_base(renderer_class, tmp_path, textured):
    linear = float(transfer("iec61966-2-1").to_linear(np.array(188 / 255)))

    def make(builder):
        told = {"sheenColorFactor": [0.9, 0.5, 0.2], "sheenRoughnessFactor": 0.6}
        if textured:
            told["sheenColorTexture"] = texel(builder, [255, 188, 255])
            told["sheenRoughnessTexture"] = texel(builder, [0, 0, 0, 128])
        return plastic(builder, {"KHR_materials_sheen": told})

    color = np.array([0.9, 0.5 * linear if textured else 0.5, 0.2])
    rough = 0.6 * (128 / 255 if textured else 1.0)
    surface = replace(PLASTIC, sheen=color, sheen_roughness=rough)
    assert_as_defined(renderer_class, tmp_path, surface, make)


@pytest.mark.parametrize("roughness", [0.15, 0.4, 1.0])
@pytest.mark.parametrize("view", [0.2, 0.5, 0.9])
def test_share_of_fibres_is_the_integral_of_their_lobe(roughness, view):
    cosines = (np.arange(80) + 0.5) / 80
    turns = (np.arange(80) + 0.5) / 80 * math.pi
    eye = np.array([math.sqrt(1 - view**2), 0, view])
    total = 0.0
    for cosine in cosines:
        for turn in turns:
            sine = math.sqrt(1 - cosine**2)
            half = eye + [sine * math.cos(turn), sine * math.sin(turn), cosine]
            lobe = fibres(half[2] / np.linalg.norm(half), cosine, view, roughness)
            total += 2 * math.pi / 6400 * cosine * lobe
    assert fibre_share(view, roughness) == pytest.approx(total, abs=0.03)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("textured", [False, True])
def test_anisotropy_stretches_highlights_along_its_direction(
    renderer_class, tmp_path, textured, metallic
):
    strength, rotation = 0.8, 0.7

    def make(builder):
        told = {"anisotropyStrength": strength, "anisotropyRotation": rotation}
        if textured:
            told["anisotropyTexture"] = texel(builder, [128, 255, 128])
        pbr = {"roughnessFactor": PLASTIC.roughness, "metallicFactor": metallic}
        color = (*PLASTIC.base, 1)
        return material(builder, color, {"KHR_materials_anisotropy": told}, pbr=pbr)

    x, y = (1 / 255, 1.0) if textured else (1.0, 0.0)
    c, s = math.cos(rotation), math.sin(rotation)
    along = np.array([c * x - s * y, s * x + c * y, 0.0])
    surface = replace(
        PLASTIC, along=along / np.linalg.norm(along), metallic=metallic,
        anisotropy=strength * (128 / 255 if textured else 1.0),
    )  # fmt: skip
    assert_as_defined(renderer_class, tmp_path, surface, make)


def test_all_layers_of_one_material_work_together(renderer_class, tmp_path):
    def make(builder):
        return plastic(builder, {
            "KHR_materials_clearcoat": {"clearcoatFactor": 0.7, "clearcoatRoughnessFactor": 0.4},
            "KHR_materials_sheen": {"sheenColorFactor": [0.2, 0.5, 0.9], "sheenRoughnessFactor": 1},
            "KHR_materials_anisotropy": {"anisotropyStrength": 0.5},
        })  # fmt: skip

    surface = replace(
        PLASTIC, coat=0.7, coat_roughness=0.4, sheen=np.array([0.2, 0.5, 0.9]),
        sheen_roughness=1.0, along=np.array([1.0, 0.0, 0.0]), anisotropy=0.5,
    )  # fmt: skip
    assert_as_defined(renderer_class, tmp_path, surface, make)


LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
GLASS = replace(PLASTIC, roughness=0.0)


def glass(builder, told, extensions=(), roughness=0.0, **fields):
    named = {"KHR_materials_transmission": told, **dict(extensions)}
    return material(builder, (*GLASS.base, 1), named, pbr={"roughnessFactor": roughness}, **fields)


def in_even_light(renderer_class, builder, tmp_path, level):
    """The middle of the picture where light of that level comes from everywhere."""
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    light = Illumination((), hemispheres(np.full(3, level), np.full(3, level)))
    with renderer_class(scene, SceneLight(0, light)) as renderer:
        layer = renderer.render(0.0, camera_at(1000.0))
    return layer.rgba[32 - layer.box.y0, 32 - layer.box.x0]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("textured", [False, True])
def test_glass_lets_light_through_by_its_luminance(renderer_class, tmp_path, turn, textured):
    builder = GlbBuilder()
    told = {"transmissionFactor": 0.9}
    volume = {"thicknessFactor": 2.0, "attenuationDistance": 4.0}
    volume["attenuationColor"] = [0.5, 0.25, 1.0]
    thickness = 1.0
    if textured:
        told["transmissionTexture"] = texel(builder, [128, 0, 0])
        volume["thicknessTexture"] = texel(builder, [0, 128, 0])
        thickness = 128 / 255
    surface, node = turned_point(GLASS, turn)
    number = glass(builder, told, {"KHR_materials_volume": volume})
    quad(builder, number=number, node=node, TEXCOORD_0=QUAD_UV)
    found = seen(renderer_class, builder, tmp_path, (3.1, 0.0))
    depth = -np.log([0.5, 0.25, 1.0]) * 2.0 / 4.0 * thickness
    through = passed(surface, 0.9 * (128 / 255 if textured else 1.0), depth)
    assert found[3] == pytest.approx(1.0 - LUMINANCE @ through, abs=2e-3)


def test_glass_over_even_light_has_its_tint(renderer_class, tmp_path):
    found = {}
    for name, roughness in (("clear", 0.0), ("frosted", 0.7)):
        builder = GlbBuilder()
        quad(builder, number=glass(builder, {"transmissionFactor": 1.0}, roughness=roughness))
        rgba = in_even_light(renderer_class, builder, tmp_path, 0.5)
        mirror = GlbBuilder()
        black = {"KHR_materials_transmission": {"transmissionFactor": 0.0}}
        pbr = {"roughnessFactor": roughness}
        quad(mirror, number=material(mirror, (0, 0, 0, 1), black, pbr=pbr))
        reflected = in_even_light(renderer_class, mirror, tmp_path, 0.5)
        over = rgba[:3] + (1.0 - rgba[3]) * 0.5
        through = passed(GLASS, 1.0, np.zeros(3))
        np.testing.assert_allclose(over, reflected[:3] + 0.5 * through, rtol=6e-3)
        found[name] = rgba[3]
    # What is behind frosted glass shows less, and the light around more.
    assert 1.0 - found["frosted"] == pytest.approx(0.3 * (1.0 - found["clear"]), rel=5e-3)


def test_metal_lets_nothing_through(renderer_class, tmp_path):
    builder = GlbBuilder()
    told = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    quad(builder, number=material(builder, (1, 1, 1, 1), told, pbr={"metallicFactor": 1}))
    assert seen(renderer_class, builder, tmp_path, SUNS[0])[3] == pytest.approx(1.0, abs=1e-3)


def test_what_stands_behind_glass_shows_through(renderer_class, tmp_path):
    builder = GlbBuilder()
    place = {"translation": [0, 0, 1]}
    quad(builder, number=glass(builder, {"transmissionFactor": 1.0}), node=place)
    quad(builder, number=unlit(builder, (0.2, 0.4, 0.8, 1)))
    found = seen(renderer_class, builder, tmp_path, (3.1, 0.0))
    shown = LUMINANCE @ passed(GLASS, 1.0, np.zeros(3))
    np.testing.assert_allclose(found, [*(shown * np.array([0.2, 0.4, 0.8])), 1], atol=3e-3)


@pytest.mark.parametrize(("alpha", "covered"), [(0.3, False), (0.7, True)])
def test_mask_cuts_holes_into_glass(renderer_class, tmp_path, alpha, covered):
    builder = GlbBuilder()
    told = {"KHR_materials_transmission": {"transmissionFactor": 0.5}}
    quad(builder, number=material(builder, (0, 0, 0, alpha), told, alphaMode="MASK"))
    found = seen(renderer_class, builder, tmp_path, (3.1, 0.0))
    assert found[3] == pytest.approx(float(covered), abs=2e-3)


def test_coat_on_glass_keeps_light_from_passing(renderer_class, tmp_path):
    builder = GlbBuilder()
    coat = {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0}}
    quad(builder, number=glass(builder, {"transmissionFactor": 1.0}, coat))
    found = seen(renderer_class, builder, tmp_path, (3.1, 0.0))
    expected = 1.0 - 0.96 * LUMINANCE @ passed(GLASS, 1.0, np.zeros(3))
    assert found[3] == pytest.approx(expected, abs=2e-3)
