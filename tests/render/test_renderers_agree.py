"""The two renderers against each other: the same pictures within antialiasing."""

import cv2
import numpy as np
import pytest
from support.folders import SAMPLES
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder
from support.quads import material, quad

from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene

SAMPLE = SAMPLES / "anim.glb"
SIZE = (160, 120)
OTHERS = ["AlphaBlendModeTest", "CesiumMan", "Fox", "KayKit_Knight", "babylon_cloth_115k"]
OTHERS += ["phoenix_bird"]


def looking_at(scene, time_s, zoom):
    bounds = scene.pose(time_s).bounds().astype(float)
    centre, radius = bounds.mean(axis=0), np.linalg.norm(bounds[1] - bounds[0]) / 2
    c, s = np.cos(0.6), np.sin(0.6)
    d, t = np.cos(-0.25), np.sin(-0.25)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ [[1, 0, 0], [0, d, -t], [0, t, d]]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, centre + turn @ [0, 0, 2.6 * radius]
    return Camera.from_yfov(pose, 0.8, SIZE[0] * zoom, SIZE[1] * zoom)


def pictures(scene, zoom, time_s=0.4):
    """Both renderers' colour and depth on the whole frame."""
    camera = looking_at(scene, time_s, zoom)
    found = []
    for kind in (SoftwareObjectRenderer, PyrenderObjectRenderer):
        with kind(scene) as renderer:
            layer = renderer.render(time_s, camera)
        rgba = np.zeros((camera.height, camera.width, 4), np.float32)
        depth = np.full(rgba.shape[:2], np.inf, np.float32)
        box = layer.box
        rgba[box.y0 : box.y1, box.x0 : box.x1] = layer.rgba
        depth[box.y0 : box.y1, box.x0 : box.x1] = layer.depth
        found.append((rgba, depth))
    return found


def assert_agree(scene):
    # How levels of a texture are mixed is antialiasing, and so are holes that a texture cuts. So
    # those are compared on large pictures; coverage by triangles is exact in any.
    if all(mesh.geometry.material.alpha_mode == "OPAQUE" for mesh in scene.pose(0.0).meshes):
        (ours, _), (theirs, _) = pictures(scene, 1)
        assert (np.abs(ours[..., 3] - theirs[..., 3]) > 0.05).mean() < 1e-4
    (ours, our_depth), (theirs, their_depth) = pictures(scene, 6)
    both = np.isfinite(our_depth) & np.isfinite(their_depth)
    assert (np.isfinite(our_depth) != np.isfinite(their_depth)).mean() < 2e-3
    assert (np.abs(our_depth[both] / their_depth[both] - 1.0) > 2e-3).mean() < 5e-3
    ours, theirs = (cv2.resize(v, SIZE, interpolation=cv2.INTER_AREA) for v in (ours, theirs))
    there = theirs[..., 3] > 0
    assert there.sum() > 500
    assert np.sqrt(((ours - theirs)[there] ** 2).mean()) < 0.01


def mixed_scene():
    """All that materials can ask for, one beside the other, lit by three kinds of lamps."""
    rng = np.random.default_rng(2)
    builder = GlbBuilder()
    noise = cv2.resize(rng.integers(0, 256, (8, 8, 4), np.uint8), (64, 64))
    trilinear = {"magFilter": 9729, "minFilter": 9987}
    paint = {"index": builder.texture(noise, **trilinear)}
    bumps = np.dstack([noise[..., :2] // 4 + 96, np.full((64, 64), 240, np.uint8)])
    kinds = [
        {"pbr": {"baseColorTexture": paint, "roughnessFactor": 0.4}},
        {"pbr": {"baseColorTexture": paint}, "alphaMode": "MASK", "alphaCutoff": 0.4},
        {"pbr": {"baseColorTexture": paint}, "alphaMode": "BLEND", "doubleSided": True},
        {"pbr": {"metallicFactor": 1, "metallicRoughnessTexture": paint}},
        {"normalTexture": {"index": builder.texture(bumps, **trilinear)}, "doubleSided": True},
        {"emissiveTexture": paint, "emissiveFactor": [0.5, 1, 0.2], "occlusionTexture": paint},
    ]
    for number, kind in enumerate(kinds):
        half = 0.5 * (0.5 * number - 1.0)
        place = {"translation": [1.2 * (number % 3), 1.5 * (number // 3), -0.4 * number]}
        place |= {"rotation": [0, np.sin(half), 0, np.cos(half)], "scale": [0.9, 0.7, 1]}
        colors = rng.random((4, 4), np.float32) if number % 2 else None
        extra = {} if colors is None else {"COLOR_0": colors}
        chosen = material(builder, (0.9, 0.8, 0.7, 0.8), {}, **kind)
        quad(builder, QUAD, chosen, place, TEXCOORD_0=QUAD_UV, **extra)
    builder.light(intensity=2.0)
    builder.light("point", intensity=6.0, node={"translation": [0, 2, 2]})
    builder.light(
        "spot", intensity=9.0, spot={"outerConeAngle": 0.9}, node={"translation": [2, 0, 3]}
    )
    return builder


@pytest.mark.needs_gl
def test_renderers_agree_on_all_materials_and_lamps(tmp_path):
    assert_agree(Scene.load(mixed_scene().write(tmp_path / "scene.glb")))


@pytest.mark.needs_gl
def test_renderers_agree_on_the_sample_object():
    assert_agree(Scene.load(SAMPLE))


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.needs_truth
@pytest.mark.parametrize("name", OTHERS)
def test_renderers_agree_on_exports_of_other_programs(shared, name):
    assert_agree(Scene.load(shared / "data/assets/gltf" / f"{name}.glb"))


def test_rasteriser_is_bit_identical_on_any_number_of_threads(tmp_path):
    scene = Scene.load(mixed_scene().write(tmp_path / "scene.glb"))
    layers = []
    for threads in (1, 2, 7):
        with SoftwareObjectRenderer(scene, threads=threads) as renderer:
            layers.append(renderer.render(0.0, looking_at(scene, 0.0, 2)))
    for layer in layers[1:]:
        np.testing.assert_array_equal(layer.rgba, layers[0].rgba)
        np.testing.assert_array_equal(layer.depth, layers[0].depth)
