"""Ground reflection against mirrored geometry and hand-worked values."""

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens
from support.glb_builder import GlbBuilder

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aberration, Bloom, Vignetting
from nlens_video.effects.camera.grain import to_code, to_linear
from nlens_video.effects.camera.softness import SharpnessFloor
from nlens_video.effects.exposure import Exposure
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.reflection import RenderReflection, mirrored_camera, schlick
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.node_registry import NODES
from nlens_video.graph.nodes.reflection import BlurReflection, CompositeReflection
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_reblur import object_coc
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


def of_plate(**measured):
    """A node's surroundings on a plate whose camera was measured."""
    return NodeContext(
        objects=None, estimate_coc=None, ground_y=None, fallback_constant=False, pixel_aspect=1.0,
        measured={
            name: Measurement(
                effect=name, value=1.0, threshold=0.0, unit="", evidence="", model=model, cost_ms=0
            )
            for name, model in measured.items()
        },
    )  # fmt: skip


def fifth_of_a_red_thing(coc_px):
    """Its mirror image."""
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[40:80, 60:100] = (0.2, 0.0, 0.0, 0.2)
    coc = np.full((HEIGHT, WIDTH), coc_px, np.float32)
    layer = ObjectLayer(box=FRAME, rgba=rgba, depth=np.ones((HEIGHT, WIDTH), np.float32))
    return DefocusedLayer(layer=layer, coc_px=coc)


def test_reflection_is_composited_with_the_blur_of_its_own_coc():
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    picture = ArrayPicture(plate.copy(), "rgb", LINEAR)
    mirrored = BlurReflection(of_plate())(fifth_of_a_red_thing(-12.0), FRAME)
    CompositeReflection(of_plate())(picture, mirrored, None)
    assert picture.array[60, 80] == pytest.approx([0.2 + 0.8 * 0.5, 0.4, 0.4], abs=1e-3)
    changed = np.flatnonzero((picture.array[60] != 0.5).any(axis=1))
    assert 60 - 8 <= changed[0] <= 60 - 5 and 100 + 4 <= changed[-1] <= 100 + 7


@pytest.mark.parametrize(
    ("node", "model"),
    [
        ("vignette", {"vignetting": Vignetting(square=1.0, fourth=0.5)}),
        ("bloom", {"bloom": Bloom(share=0.3, length_px=4.0)}),
        ("soften", {"softness": SharpnessFloor(sigma_px=1.5)}),
        ("chromatic-aberration", {"aberration": Aberration(red=(2.0, 0.0), blue=(-1.0, 0.0))}),
        ("match-exposure", {}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_mirror_image_gets_what_the_plates_camera_does_to_the_object(node, model):
    rng = np.random.default_rng(0)
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[20:60, 90:140] = np.float32([2.0, 1.5, 0.4, 0.7]) * rng.uniform(0.5, 1, (40, 50, 1))
    layer = BlurredLayer(box=FRAME, rgba=rgba)
    coc = DefocusedLayer(
        layer=ObjectLayer(box=FRAME, rgba=rgba, depth=np.ones((HEIGHT, WIDTH), np.float32)),
        coc_px=np.zeros((HEIGHT, WIDTH), np.float32),
    )
    plate = np.float32(rng.uniform(0.1, 0.6, (HEIGHT, WIDTH, 3)))
    given = {
        "blurred": layer, "mirrored": layer, "frame_box": FRAME, "defocused": coc,
        "reflection": coc, "picture": ArrayPicture(plate, "rgb", LINEAR),
        "exposure": Exposure(gains=(0.5, 0.6, 0.7)),
    }  # fmt: skip
    done = []
    for name in (node, f"{node}-reflection"):
        one = NODES[name](of_plate(**model))
        done.append(one.run(*(given[port.name] for port in one.inputs())))
    of_object, of_mirror = done
    assert of_object.box == of_mirror.box and np.array_equal(of_object.rgba, of_mirror.rgba)
    assert not np.array_equal(of_mirror.rgba, rgba)


def test_softness_of_the_mirror_image_is_that_of_its_own_blur():
    given = of_plate(softness=SharpnessFloor(sigma_px=1.5))
    layer = BlurReflection(given)(fifth_of_a_red_thing(0.0), FRAME)
    soft = NODES["soften-reflection"](given)
    assert soft(layer, FRAME, fifth_of_a_red_thing(9.0)) is layer  # softer than the plate's edges
    assert soft(layer, FRAME, fifth_of_a_red_thing(0.0)) is not layer


@pytest.mark.slow
@pytest.mark.needs_gl
def test_command_lets_the_mirror_image_fade_and_be_as_noisy_as_the_plate(tmp_path):
    glb = shots.cube_glb(tmp_path / "a.glb", start=(0.0, 0.0, -4.0), size=0.5)
    fit = shots.fit_json(tmp_path / "fit.json")
    frames, rng = 6, np.random.default_rng(1)
    fading = np.linspace(1.0, 0.4, frames)
    light = to_linear(np.float32(shots.plate() / 255.0))
    for name, gains, levels in (("fades", fading, 0.0), ("noisy", np.ones(frames), 4.0)):
        for at, gain in enumerate(gains):
            code = 255.0 * to_code(np.float32(gain) * light)
            code += levels * rng.standard_normal(code.shape)
            shots.write_png(tmp_path / f"{name}_{at:03d}.png", np.uint8(code.clip(0, 255).round()))
        words = [tmp_path / f"{name}_%03d.png", glb, tmp_path / f"{name}_out_%03d.png"]
        asked = ["--fit", fit, "--ground-reflectance", "0.9", "--effects", "auto,-shadow", "-q"]
        assert nlens(*words, *asked).returncode == 0

    def read(name):
        """The mirror image's middle."""
        return np.stack([
            cv2.imread(str(tmp_path / f"{name}_{at:03d}.png"))[126:150, 226:254]
            for at in range(frames)
        ]).astype(np.float32)  # fmt: skip

    first, last = (to_linear(read("fades_out")[at] / 255.0).mean() for at in (0, -1))
    assert last / first == pytest.approx(fading[-1], rel=0.03)
    deviation = read("noisy_out").std(axis=0, ddof=1)
    assert np.sqrt(np.square(deviation).mean()) == pytest.approx(4.0, rel=0.1)
