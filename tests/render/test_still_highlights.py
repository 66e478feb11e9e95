"""Highlights of smooth, curved surfaces are steady: a sphere moves by parts of a pixel."""

import math

import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_FACES, GlbBuilder
from support.quads import camera_at

from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene
from nlens_video.scene.environment import reduce_environment
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.scene_light import SceneLight

METAL = {"pbrMetallicRoughness": {"roughnessFactor": 0.1}}
COAT = {
    "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0},
    "extensions": {
        "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.1},
        "KHR_materials_specular": {"specularFactor": 0},
    },
}
DARK = Illumination((), None)
STRETCHED = {**METAL, "extensions": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.3}}}


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    """Every test of this file is one of each renderer."""
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


def sphere(rows=64):
    """Positions, which are the normals too, texture coordinates and faces of a unit sphere."""
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, 2 * rows), indexing="ij")
    up, around = math.pi * v, 2.0 * math.pi * u
    places = [np.sin(up) * np.cos(around), np.cos(up), -np.sin(up) * np.sin(around)]
    corner = np.arange(rows * 2 * rows).reshape(rows, 2 * rows)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    faces = np.stack([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    uv = np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)
    return np.stack(places, -1).reshape(-1, 3).astype(np.float32), uv, faces.astype(np.uint32)


def sphere_scene(folder, material, sun=(1.0, 1.0, 1.0)):
    builder = GlbBuilder()
    places, uv, faces = sphere()
    number = builder.add("materials", material)
    builder.node(mesh=builder.mesh(places, faces, material=number, NORMAL=places, TEXCOORD_0=uv))
    toward = np.array(sun) / np.linalg.norm(sun)
    turn = np.array([*np.cross([0.0, 0.0, 1.0], toward), 1.0 + toward[2]])
    builder.light(intensity=3.0, node={"rotation": (turn / np.linalg.norm(turn)).tolist()})
    return Scene.load(builder.write(folder / "scene.glb"))


def seen(renderer, radius, frame, finer=1):
    """The sphere's light on pixels (h, w) of the whole frame, by `finer` squared samples each."""
    pose = np.eye(4)
    pose[:3, 3] = 0.13 * frame / radius, 0.04 * frame / radius, 50.0
    pixels = int(3.2 * radius)
    side, focal = pixels * finer, 50.0 * radius * finer
    camera = Camera(
        world_from_camera=pose, fx=focal, fy=focal, cx=0.5 * side, cy=0.5 * side,
        width=side, height=side,
    )  # fmt: skip
    layer = renderer.render(0.0, camera, plate_light=DARK)
    frame_light, box = np.zeros((side, side)), layer.box
    frame_light[box.y0 : box.y1, box.x0 : box.x1] = layer.rgba[..., 1]
    return frame_light.reshape(pixels, finer, pixels, finer).mean(axis=(1, 3))


@pytest.mark.parametrize("radius", [12, 30])
@pytest.mark.parametrize(("material", "off"), [(METAL, 0.08), (COAT, 0.22), (STRETCHED, 0.08)])
def test_light_of_a_moving_sphere_is_that_of_finer_samples(
    renderer_class, tmp_path, material, off, radius
):
    """A coat's mean is less exact: at grazing angles wider highlights count for more."""
    scene = sphere_scene(tmp_path, material)
    with renderer_class(scene) as renderer:
        sums = np.array([seen(renderer, radius, frame).sum() for frame in range(16)])
        exact = np.mean([seen(renderer, radius, frame, 12).sum() for frame in (0, 9)])
    assert sums.mean() == pytest.approx(exact, rel=off)
    assert sums.std() < 0.1 * exact


def striped():
    """Light from stripes around, each as wide as 5 degrees."""
    across = np.arange(512)[None] // 7 % 2
    return reduce_environment(np.broadcast_to(across[..., None], (256, 512, 3)).astype(np.float32))


def test_sphere_mirrors_fine_stripes_as_finer_samples_do(renderer_class, tmp_path):
    radius = 12
    scene = sphere_scene(tmp_path, {"pbrMetallicRoughness": {"roughnessFactor": 0}})
    with renderer_class(scene, SceneLight(0, striped())) as renderer:
        found, exact = seen(renderer, radius, 0), seen(renderer, radius, 0, 8)
    y, x = np.indices(found.shape) + 0.5 - 0.5 * len(found)
    inner = np.hypot(x, y) < 0.7 * radius
    assert np.sqrt(np.mean((found - exact)[inner] ** 2)) < 0.05


@pytest.mark.parametrize("roughness", [0.0, 0.1])
def test_highlight_of_a_flat_surface_is_as_narrow_as_its_material_says(
    renderer_class, tmp_path, roughness
):
    """At its peak: head on, a metal returns 1 / (4 pi alpha^2) of what falls on it."""
    builder = GlbBuilder()
    metal = {"pbrMetallicRoughness": {"roughnessFactor": roughness}}
    normals = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    number = builder.add("materials", metal)
    builder.node(mesh=builder.mesh(QUAD, QUAD_FACES, material=number, NORMAL=normals))
    builder.light(intensity=1e-3)
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    with renderer_class(scene) as renderer:
        layer = renderer.render(0.0, camera_at(1e4, 9, 9), plate_light=DARK)
    alpha = max(roughness**2, 0.002)
    peak = 1e-3 / (4.0 * math.pi * alpha**2)
    assert layer.rgba[..., 1].max() == pytest.approx(peak, rel=5e-3)
