"""No surface sends back more light than it gets: a white one in even light is as bright as that."""

import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder
from support.quads import camera_at, material, quad

from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.scene.illumination import Illumination, hemispheres
from nlens_video.scene.scene_light import SceneLight

EVEN = Illumination((), hemispheres(np.ones(3), np.ones(3)))


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    """Every test of this file is one of each renderer."""
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


def in_even_light(renderer_class, folder, cosine, color, extensions, **pbr):
    """Colour (3,) of a quad turned so that the eye sees it at a cosine."""
    builder = GlbBuilder()
    half = 0.5 * math.acos(cosine)
    number = material(builder, (*color, 1), extensions, pbr=pbr)
    quad(builder, number=number, node={"rotation": [0, math.sin(half), 0, math.cos(half)]})
    scene = Scene.load(builder.write(folder / "scene.glb"))
    with renderer_class(scene, SceneLight(0, EVEN)) as renderer:
        layer = renderer.render(0.0, camera_at(1000.0))
    rgba = layer.rgba[32 - layer.box.y0, 32 - layer.box.x0]
    assert rgba[3] == pytest.approx(1.0, abs=1e-3)
    return rgba[:3]


@pytest.mark.parametrize("cosine", [1.0, 0.3, 0.2])
@pytest.mark.parametrize("roughness", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(
    ("metallic", "extensions"),
    [
        (0.0, {}),
        (0.0, {"KHR_materials_ior": {"ior": 2.4}}),
        (1.0, {}),
        (0.0, {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}),
    ],
)
def test_white_surface_in_even_light_returns_all_of_it(
    renderer_class, tmp_path, cosine, roughness, metallic, extensions
):
    pbr = {"metallicFactor": metallic, "roughnessFactor": roughness}
    found = in_even_light(renderer_class, tmp_path, cosine, (1, 1, 1), extensions, **pbr)
    np.testing.assert_allclose(found, 1.0, atol=2e-3)


@pytest.mark.parametrize("cosine", [1.0, 0.3])
def test_what_a_dielectric_mirrors_is_taken_from_all_colours_alike(
    renderer_class, tmp_path, cosine
):
    """As under lamps, by glTF 2.0's appendix B: else a surface would be tinted at its rim."""
    told = {"KHR_materials_specular": {"specularColorFactor": [0.2, 1.0, 0.2]}}
    shares = [
        in_even_light(renderer_class, tmp_path, cosine, color, told, roughnessFactor=0.2)
        for color in ((0, 0, 0), (0.8, 0.8, 0.8))
    ]
    mirrored, both = shares
    assert mirrored[1] > 1.5 * mirrored[0] or cosine < 0.5
    np.testing.assert_allclose(both - mirrored, 0.8 * (1.0 - mirrored.max()), atol=2e-3)
