"""Ground reflection against mirrored geometry and hand-worked values."""

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.reflection import (
    OverlayReflection,
    RenderReflection,
    mirrored_camera,
    schlick,
)
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_reblur import ReblurLayer, object_coc
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 160, 120
FRAME = Box(0, 0, WIDTH, HEIGHT)
GROUND = 0.25
TILT = 0.3
# A pyramid with four sides of different colours, its tip aside: nothing about it is symmetric.
TIP = np.array([0.3, 1.0, 0.1])
CORNERS = np.array([[-0.5, 0, 0.5], [0.6, 0, 0.4], [0.5, 0, -0.5], [-0.4, 0, -0.6]])
COLORS = ([0.9, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.2, 0.9], [0.8, 0.8, 0.1])


def pyramid(path, *, mirrored=False, sunk=0.0):
    """The pyramid on the ground; as its mirror image would lie below it."""
    builder = GlbBuilder()
    for side, color in enumerate(COLORS):
        points = np.array([CORNERS[side], CORNERS[(side + 1) % 4], TIP]) + (0, GROUND - sunk, 0)
        if mirrored:
            points = (points * (1, -1, 1) + (0, 2 * GROUND, 0))[::-1]
        paint = builder.add(
            "materials",
            {
                "pbrMetallicRoughness": {"baseColorFactor": [*color, 1]},
                "extensions": {"KHR_materials_unlit": {}},
            },
        )
        mesh = builder.mesh(points.astype(np.float32), np.array([[0, 1, 2]]), material=paint)
        builder.node(mesh=mesh)
    c, s = np.cos(TILT), np.sin(TILT)
    pose = np.array([[1, 0, 0, 0.2], [0, c, s, 1.5], [0, -s, c, 4.0], [0, 0, 0, 1]])
    builder.node(camera=builder.camera(0.6), matrix=pose.T.ravel().tolist())
    return Scene.load(builder.write(path))


def on_frame(layer):
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    depth = np.full((HEIGHT, WIDTH), np.inf, np.float32)
    inside = layer.box.intersection(FRAME)
    rgba[inside.slices_in(FRAME)] = layer.rgba[inside.slices_in(layer.box)]
    depth[inside.slices_in(FRAME)] = layer.depth[inside.slices_in(layer.box)]
    return rgba, depth


def test_mirrored_camera_is_a_rotation_below_the_ground_and_sees_the_reflection(tmp_path):
    camera = pyramid(tmp_path / "a.glb").camera(0.0, WIDTH, HEIGHT)
    below = mirrored_camera(camera, GROUND)
    assert np.linalg.det(below.world_from_camera[:3, :3]) == pytest.approx(1.0)
    assert below.world_from_camera[1, 3] == pytest.approx(2 * GROUND - 1.5)
    point, image = np.array([[0.3, 0.95, 0.2]]), np.array([[0.3, 2 * GROUND - 0.95, 0.2]])
    x, y = camera.pixels(camera.to_camera(image))[0]
    seen = below.to_camera(point)
    assert below.pixels(seen)[0] == pytest.approx((WIDTH - x, y))
    assert seen[0, 2] == pytest.approx(camera.to_camera(image)[0, 2])


@pytest.mark.needs_gl
def test_reflection_equals_the_picture_of_the_mirrored_object(tmp_path):
    scene = pyramid(tmp_path / "a.glb")
    camera = scene.camera(0.0, WIDTH, HEIGHT)
    with PyrenderObjectRenderer(scene) as renderer:
        draw = RenderReflection(renderer=renderer, reflectance=1.0)
        fit = LensFit(slope=50.0, intercept=-10.0, width=WIDTH, height=HEIGHT)
        got = object_coc(draw(0.0, camera, GROUND, 8.0), fit)
    with PyrenderObjectRenderer(pyramid(tmp_path / "b.glb", mirrored=True)) as renderer:
        truth_rgba, truth_depth = on_frame(renderer.render(0.0, camera))
    rgba, depth = on_frame(got.layer)
    both = (rgba[..., 3] == 1) & (truth_rgba[..., 3] == 1)
    assert both.sum() > 500
    # antialiased edges turn round with the picture: they may differ, whole pixels may not
    assert ((rgba[..., 3] > 0) != (truth_rgba[..., 3] > 0)).mean() < 0.004
    assert np.abs(rgba - truth_rgba)[both].max() < 0.02
    assert depth[both] == pytest.approx(truth_depth[both], rel=1e-4)
    coc = got.coc_px[got.layer.rgba[..., 3] == 1]
    of_depth = 50.0 / got.layer.depth[got.layer.rgba[..., 3] == 1] - 10.0
    assert coc == pytest.approx(of_depth, abs=1e-3)


@pytest.mark.needs_gl
def test_geometry_below_the_ground_has_no_reflection(tmp_path):
    scene = pyramid(tmp_path / "a.glb", sunk=0.4)
    camera = scene.camera(0.0, WIDTH, HEIGHT)
    with PyrenderObjectRenderer(scene) as renderer:
        got = RenderReflection(renderer=renderer, reflectance=1.0)(0.0, camera, GROUND, 0.0)
    rgba, depth = on_frame(got)
    there = rgba[..., 3] > 0
    assert there.sum() > 100
    plane = camera.plane_disparity(GROUND)
    assert (depth[there] * plane[there] >= 0.998).all()


@pytest.mark.needs_gl
def test_camera_below_the_ground_or_object_out_of_view_gives_no_reflection(tmp_path):
    scene = pyramid(tmp_path / "a.glb")
    camera = scene.camera(0.0, WIDTH, HEIGHT)
    with PyrenderObjectRenderer(scene) as renderer:
        draw = RenderReflection(renderer=renderer, reflectance=1.0)
        assert draw(0.0, camera, 2.0, 0.0) is None
        assert draw(0.0, camera, -50.0, 0.0) is None


def test_reflectance_follows_schlicks_approximation():
    # 0.04 + 0.96 (1 - cos)^5, by hand
    cosine = np.array([1.0, 0.5, 0.2, 0.0])
    assert schlick(cosine, 0.04) == pytest.approx([0.04, 0.07, 0.354573, 1.0], abs=1e-6)
    assert schlick(cosine, 1.0) == pytest.approx(1.0)


class Wall:
    """Fills the frame at a depth, seen from anywhere."""

    def render(self, time_s, camera, margin=0, plate_light=None):
        box = Box(0, 0, camera.width, camera.height).expanded(margin)
        rgba = np.ones((box.height, box.width, 4), np.float32)
        return ObjectLayer(
            box=box, rgba=rgba, depth=np.full((box.height, box.width), 1e6, np.float32)
        )


def test_reflectance_is_evaluated_for_each_pixels_ray(tmp_path):
    camera = pyramid(tmp_path / "a.glb").camera(0.0, WIDTH, HEIGHT)
    layer = RenderReflection(renderer=Wall(), reflectance=0.04)(0.0, camera, GROUND, 0.0)
    rgba, _ = on_frame(layer)
    for row, column in ((119, 80), (90, 10), (40, 150)):
        ray = np.array(
            [(column + 0.5 - camera.cx) / camera.fx, -(row + 0.5 - camera.cy) / camera.fy, -1.0]
        )
        ray = camera.world_from_camera[:3, :3] @ (ray / np.linalg.norm(ray))
        expected = 0.04 + 0.96 * (1.0 + ray[1]) ** 5 if ray[1] < 0 else 0.0
        assert rgba[row, column, 3] == pytest.approx(expected, abs=1e-5)


def test_reflection_is_composited_with_the_blur_of_its_own_coc():
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[40:80, 60:100] = (0.2, 0.0, 0.0, 0.2)  # a fifth of a red thing
    coc = np.full((HEIGHT, WIDTH), -12.0, np.float32)
    layer = ObjectLayer(box=FRAME, rgba=rgba, depth=np.ones((HEIGHT, WIDTH), np.float32))
    picture = ArrayPicture(plate.copy(), "rgb", LINEAR)
    lay = OverlayReflection(ReblurLayer(scatter=scatter, reach=blur_reach))
    lay(picture, DefocusedLayer(layer=layer, coc_px=coc), FRAME)
    assert picture.array[60, 80] == pytest.approx([0.2 + 0.8 * 0.5, 0.4, 0.4], abs=1e-3)
    changed = np.flatnonzero((picture.array[60] != 0.5).any(axis=1))
    assert 60 - 8 <= changed[0] <= 60 - 5 and 100 + 4 <= changed[-1] <= 100 + 7
