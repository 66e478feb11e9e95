"""Shadows of transparent and of static objects: alpha masks, blended panes, reuse over frames."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.calls import calls_of
from support.glb_builder import QUAD_FACES, GlbBuilder
from support.overhead import HEIGHT, WIDTH, looking_down

from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.objects import Playback
from nlens_video.core.optics import Shutter
from nlens_video.effects.motion_blur import Motion
from nlens_video.effects.shadow.ambient import pattern_level
from nlens_video.effects.shadow.cast import CastShadow
from nlens_video.effects.shadow.casters import CasterCache, Casters, Moment
from nlens_video.effects.shadow.coverage import covered_reference, edges_of, mark_covered
from nlens_video.effects.shadow.transparency import absorb, absorb_reference, no_absorption
from nlens_video.graph.base.context import NodeContext, ShadowScene
from nlens_video.graph.base.object_source import RenderedObject
from nlens_video.graph.base.view import ScreenBounds, View
from nlens_video.graph.nodes.ground import (
    BlurShadow,
    CompositeShadow,
    ShadowCasters,
    ShadowNode,
    equal_values,
)
from nlens_video.scene import Scene
from nlens_video.scene.illumination import Illumination, Lamp, Light, PosedLight, sun
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

FRAME = Box(0, 0, WIDTH, HEIGHT)
CARD = np.array([[-1, 1, -1], [1, 1, -1], [1, 1, 1], [-1, 1, 1]], np.float32)
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
NORMALS = np.tile(np.array([[0, 1, 0]], np.float32), (4, 1))
NOON = Illumination((Lamp(sun(np.ones(3), np.array([0.0, -1.0, 0.0])), 1e-6),), np.zeros((9, 3)))


STILL = Shutter()


def card(path, mode, *, alpha=None, factor=1.0, colors=None, layers=1, motion=False, **material):
    """Cards of two units, one unit above the ground and more, under a sun at noon."""
    builder = GlbBuilder()
    pbr = {"baseColorFactor": [1, 1, 1, factor]}
    if alpha is not None:
        rgba = np.full((*alpha.shape, 4), 255, np.uint8)
        rgba[..., 3] = alpha
        pbr["baseColorTexture"] = {"index": builder.texture(rgba)}
    paint = builder.add("materials", {"pbrMetallicRoughness": pbr, "alphaMode": mode, **material})
    more = {} if colors is None else {"COLOR_0": np.asarray(colors, np.float32)}
    mesh = builder.mesh(CARD, QUAD_FACES, material=paint, NORMAL=NORMALS, TEXCOORD_0=UV, **more)
    nodes = [builder.node(mesh=mesh, translation=[0, 0.2 * at, 0]) for at in range(layers)]
    if motion:
        keys = np.array([[0, 0, 0], [0, 0, 0], [0.5, 0, 0]], np.float32)
        builder.animation((nodes[0], "translation", [0.0, 1.0, 2.0], keys, "LINEAR"))
    builder.light(intensity=1.0, node={"rotation": [-(0.5**0.5), 0, 0, 0.5**0.5]})
    return Scene.load(builder.write(path), Playback())


def loss_under(scene):
    casters = Casters.of(scene.pose(0.0), CasterCache())
    shadow = CastShadow(lamp_points=16)([Moment(casters, looking_down())], NOON, 0.0, None)
    whole = np.zeros((HEIGHT, WIDTH), np.float32)
    if shadow is not None:
        inside = shadow.box.intersection(FRAME)
        whole[inside.slices_in(FRAME)] = shadow.loss[inside.slices_in(shadow.box)][..., 0]
    return whole


def halves(left, right):
    """A texture of two halves."""
    alpha = np.full((16, 16), left, np.uint8)
    alpha[:, 8:] = right
    return alpha


def test_alpha_mask_texture_casts_a_shadow_with_a_hole(tmp_path):
    dark = loss_under(card(tmp_path / "a.glb", "MASK", alpha=halves(255, 0)))
    # The card covers columns 60 to 100 and rows 40 to 80; its right half is a hole.
    assert dark[42:78, 62:78] == pytest.approx(0.999, abs=1e-3)
    assert not dark[:, 82:].any() and not dark[:, :59].any()


@pytest.mark.parametrize(("cutoff", "hides"), [(0.3, True), (0.6, False)])
def test_alpha_cutoff_decides_which_texels_are_holes(tmp_path, cutoff, hides):
    scene = card(tmp_path / "a.glb", "MASK", alpha=halves(102, 102), alphaCutoff=cutoff)
    dark = loss_under(scene)
    assert (dark[42:78, 62:98] > 0.99).all() if hides else not dark.any()


def test_blended_panes_absorb_by_their_alpha_and_multiply(tmp_path):
    one = loss_under(card(tmp_path / "a.glb", "BLEND", alpha=halves(102, 204)))
    assert one[45:75, 63:77] == pytest.approx(0.4, abs=1e-3)
    assert one[45:75, 83:97] == pytest.approx(0.8, abs=1e-3)
    two = loss_under(card(tmp_path / "b.glb", "BLEND", factor=0.4, layers=2))
    assert two[45:75, 63:97] == pytest.approx(1 - 0.6**2, abs=1e-3)


def lamp_at(height):
    """A point light above the cards."""
    light = Light(kind="point", color=(1.0, 1.0, 1.0), intensity=1.0)
    posed = PosedLight(light, np.array([0.3, height, 0.1]), np.array([0.0, -1.0, 0.0]))
    return Illumination((Lamp(posed),), np.zeros((9, 3)))


@pytest.mark.parametrize("light", [NOON, lamp_at(4.0), lamp_at(1.3)], ids=["sun", "high", "amid"])
@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_panes_drawn_together_cast_the_shadow_of_each_drawn_alone(tmp_path, mode, light):
    alpha = np.random.default_rng(2).integers(0, 256, (16, 16), np.uint8)
    scene = card(tmp_path / "a.glb", mode, alpha=alpha, factor=0.9, layers=4)
    together = Casters.of(scene.pose(0.0), CasterCache())
    each = [replace(one, opacity=replace(one.opacity)) for one in together.transparent]
    shadows = [
        CastShadow()([Moment(casters, looking_down())], light, 0.0, None)
        for casters in (together, replace(together, transparent=tuple(each)))
    ]
    assert len({one.opacity for one in together.transparent}) == 1
    assert shadows[0].box == shadows[1].box and shadows[0].loss.max() > 0.5
    np.testing.assert_array_equal(shadows[0].loss, shadows[1].loss)


def test_pane_more_costs_a_shadow_few_calls(tmp_path):
    def calls(count):
        scene = card(tmp_path / "a.glb", "BLEND", factor=0.4, layers=count)
        casters = Casters.of(scene.pose(0.0), CasterCache())
        cast = CastShadow(threads=1)
        return calls_of(lambda: cast([Moment(casters, looking_down())], NOON, 0.0, None))

    assert calls(40) - calls(20) <= 20 * 60


def test_surfaces_of_one_picture_share_its_opacity(tmp_path):
    builder = GlbBuilder()
    rgba = np.full((8, 8, 4), 100, np.uint8)
    picture = {"baseColorTexture": {"index": builder.texture(rgba)}}
    for color in (1.0, 0.5):
        chosen = {"pbrMetallicRoughness": {**picture, "baseColorFactor": [color, 1, 1, 1]}}
        paint = builder.add("materials", {**chosen, "alphaMode": "BLEND"})
        builder.node(mesh=builder.mesh(CARD, QUAD_FACES, material=paint, TEXCOORD_0=UV))
    posed = Scene.load(builder.write(tmp_path / "a.glb"), Playback()).pose(0.0)
    first, second = Casters.of(posed, CasterCache()).transparent
    assert first.opacity is second.opacity


def test_distance_to_many_casters_takes_a_bounded_memory():
    rng = np.random.default_rng(4)
    ground = rng.normal(size=(40, 50, 3)).astype(np.float32)
    points = rng.normal(size=(5000, 3)) + (0.0, 4.0, 0.0)
    tracemalloc.start()
    found = pattern_level(ground, np.full((40, 50), 0.1), points, 400.0, 0.1)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 8e6
    some = ground[::13, ::7].astype(np.float64)
    nearest = np.linalg.norm(some[:, :, None] - points, axis=-1).min(axis=-1)
    expected = np.log2(nearest * 0.1 * 0.5 * 0.1 * 400.0 / 0.7).clip(-1.0, 5.999) + 1.0
    np.testing.assert_allclose(found[::13, ::7], expected, atol=1e-3)


def test_vertex_and_material_alpha_scale_the_absorption(tmp_path):
    colors = np.array([[1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0]])
    dark = loss_under(card(tmp_path / "a.glb", "BLEND", colors=colors, factor=0.5))
    ramp = (np.arange(62, 98) + 0.5 - 60) / 40 * 0.5
    assert dark[60, 62:98] == pytest.approx(ramp, abs=0.01)


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
def test_fully_opaque_meshes_use_the_coverage_bitmap(tmp_path, mode):
    casters = Casters.of(card(tmp_path / "a.glb", mode).pose(0.0), CasterCache())
    assert not casters.transparent and len(casters.faces) == 2
    assert loss_under(card(tmp_path / "b.glb", "OPAQUE", alpha=halves(0, 0)))[60, 80] > 0.99


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_absorption_kernel_agrees_with_the_reference(seed):
    rng = np.random.default_rng(seed)
    size, at = (13, 17), (0.3, 0.7)
    points = rng.normal(size=(9, 3)) * (20, 20, 1) + (8, 6, 0.7)
    surface = rng.normal(size=(9, 3)) * (1.5, 1.5, 0.5) + (0, 0, 0.7)
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    texture = (
        rng.random((5, 7), np.float32),
        (int(rng.integers(3)), int(rng.integers(3))),
        float(rng.choice([-1.0, 0.35])),
    )
    opaque = rng.normal(size=(3, 3)) * (20, 20, 1) + (8, 6, 0.7)
    bits, veiled = np.zeros(size, np.uint8), no_absorption(*size)
    one = np.array([[0, 1, 2]], np.int32)
    for call in (1, 2):  # a second call takes as much again
        mark_covered(bits, (opaque, one, edges_of(one)), [(call - 1, np.eye(3, 4), at)])
        absorb(veiled, (bits, call - 1), points, surface, faces, texture, call, at)
    truth = absorb_reference(size, points, surface, faces, texture, at)
    truth[covered_reference(size, opaque, one, at)] = 0.0
    assert (np.abs(veiled.taken - 2 * truth) > 1e-3).sum() <= 2  # pixels on an edge


def stages(scene, shutter=STILL):
    """The shadow's node, and what darkens a plate by it."""
    view = View(width=WIDTH, height=HEIGHT, placed=looking_down())
    context = NodeContext(
        objects=RenderedObject(scene=scene, renderer=None, view=view), shutter=shutter,
        estimate_coc=None,
        ground_y=0.0, fallback_constant=False, pixel_aspect=1.0,
        shadow_scene=ShadowScene(
            pose=scene.pose, light=SceneLight(scene.light_count), pre_rendered=False, strength=1.0
        ),
    )  # fmt: skip
    blur, composite = BlurShadow(context), CompositeShadow(context)

    def darken(picture, shadow):
        return composite(picture, blur(picture, shadow, FRAME, None, None))

    casters, cast = ShadowCasters(context), ShadowNode(context)

    def shadow(bounds, fit, motion):
        return cast(casters(bounds, fit, motion), fit, None)

    return shadow, darken


def placed(time_s, camera=None):
    return ScreenBounds(
        time_s=time_s, camera=camera or looking_down(), box=FRAME, nearest=8.0, farthest=9.0
    )


def test_shadow_is_cast_again_only_if_object_camera_or_fit_changes(tmp_path):
    scene = card(tmp_path / "a.glb", "BLEND", factor=0.4, motion=True)
    shadow, _ = stages(scene)
    fit = LensFit(slope=20.0, intercept=-8.0, width=WIDTH, height=HEIGHT)
    first = shadow(placed(0.0), fit, None)
    assert shadow(placed(0.5), fit, None) is first  # it rests until 1 s
    assert shadow(placed(0.5), None, None) is not first
    again = shadow(placed(0.6), fit, None)
    assert np.array_equal(again.loss, first.loss)
    moved = looking_down()
    moved.world_from_camera[0, 3] = 0.1
    assert shadow(placed(0.6, moved), fit, None) is not again
    assert shadow(placed(1.5), fit, None).box != first.box


def test_shadow_of_a_moving_object_has_motion_blur_if_enabled(tmp_path):
    scene = card(tmp_path / "a.glb", "OPAQUE", motion=True)  # by half a unit from 1 s to 2 s
    motion = Motion(span_px=5.0, spread_px=0.0, refocus_px=0.0, ways=np.array([[5.0, 0.0]]))

    def profile(shutter, given):
        shadow = stages(scene, shutter)[0](placed(1.5), None, given)
        row = shadow.loss[60 - shadow.box.y0, :, 0]
        return int((row > 0.2).sum()), float(np.abs(np.diff(row)).max())

    still = profile(Shutter(frame_s=1.0), None)
    assert profile(Shutter(frame_s=0.1), motion) == still  # its shadow moves by half a pixel
    wide, steepest = profile(Shutter(frame_s=1.0), motion)  # by five
    assert wide > still[0] and steepest < 0.6 * still[1]


def test_static_shadow_darkens_every_frame_identically(tmp_path):
    shadow, darken = stages(card(tmp_path / "a.glb", "BLEND", factor=0.4))
    fit = LensFit(slope=20.0, intercept=-8.0, width=WIDTH, height=HEIGHT)
    results = []
    for time_s in (0.0, 0.1):
        picture = ArrayPicture(np.full((HEIGHT, WIDTH, 3), 0.5, np.float32), "rgb", LINEAR)
        darken(picture, shadow(placed(time_s), fit, None))
        results.append(picture.array)
    # 0.4 of the sun, which gives a third of the light, is gone, and some of the light around
    assert np.array_equal(*results) and 0.35 < results[0].min() < 0.5 * (1 - 0.4 / 3)


def test_values_are_equal_if_their_types_and_numbers_are_equal():
    assert equal_values(looking_down(), looking_down())
    moved = looking_down()
    moved.world_from_camera[0, 3] = 1e-6
    assert not equal_values(looking_down(), moved)
    assert equal_values((1, (None, np.zeros(3))), (1, (None, np.zeros(3))))
    assert (
        not equal_values((1, 2), (1,))
        and not equal_values(1, 1.0)
        and not equal_values(None, np.zeros(3))
    )
