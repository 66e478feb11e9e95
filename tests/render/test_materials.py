"""Material extensions of glTF: both renderers against the specification's formulas in NumPy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.glb_builder import QUAD_UV, GlbBuilder
from support.quads import camera_at, draw, material, quad

from nlens_video.core.color import transfer
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.reference_kernels import SurfacePoint, reflectance
from nlens_video.render.software.renderer import SoftwareObjectRenderer

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
