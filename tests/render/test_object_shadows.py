"""Shadows that parts of the object, and objects, cast on each other."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder
from support.native_levels import assert_same_bits
from support.quads import material, quad

from nlens_video.native import kernels
from nlens_video.render.base import light_depth, light_depth_ref
from nlens_video.render.base.light_depth import LightDepth
from nlens_video.render.base.opacity import Opacities
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene
from nlens_video.scene.illumination import Illumination, Lamp, Light, PosedLight, sun
from nlens_video.scene.scene_light import SceneLight

RENDERERS = [
    SoftwareObjectRenderer,
    pytest.param(PyrenderObjectRenderer, marks=pytest.mark.needs_gl),
]
DOWN = np.array([0.0, -1.0, 0.0])
LYING = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # a quad's rotation that turns it to face up
SIDE = 120  # of a picture [px]


def above(height=20.0, size=2.4, x=0.0, z=0.0):
    """A camera that looks straight down on a square of the ground of that size."""
    pose = np.eye(4)
    pose[:3, 1], pose[:3, 2] = (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)
    pose[:3, 3] = x, height, z
    f = SIDE * height / size
    return Camera(
        world_from_camera=pose, fx=f, fy=f, cx=SIDE / 2, cy=SIDE / 2, width=SIDE, height=SIDE
    )


def lying(builder, size, height, x=0.0, number=None, **attributes):
    """A square that lies level, at a height."""
    node = {"rotation": LYING, "translation": [x, height, 0.0]}
    positions = (QUAD * (size / np.ptp(QUAD[:, 0]))).astype(np.float32)
    quad(builder, positions, number, node, **attributes)


def slab_below_a_card(folder, size=0.6, height=0.5, **card):
    """A white slab of two metres with a black card above its middle."""
    builder = GlbBuilder()
    lying(builder, 2.0, 0.0, number=material(builder))
    own = material(builder, (0.0, 0.0, 0.0, card.pop("alpha", 1.0)), **card)
    lying(builder, size, height, number=own, TEXCOORD_0=QUAD_UV)
    return Scene.load(builder.write(folder / "scene.glb"))


def under(lamps):
    return Illumination(tuple(lamps), None)


def picture(renderer, scene, lamps, camera, *, shadows=True):
    """Red light of a scene under lamps (SIDE, SIDE), that of nothing 0."""
    with renderer(scene, SceneLight(0)) as opened:
        if shadows:
            opened.shade_itself()
        layer = opened.render(0.0, camera, plate_light=under(lamps))
    whole = np.zeros((SIDE, SIDE), np.float32)
    whole[layer.box.y0 : layer.box.y1, layer.box.x0 : layer.box.x1] = layer.rgba[..., 0]
    return whole


def shaded(renderer, scene, lamp):
    """Where a scene loses more than half of the lamp's light, seen from above (SIDE, SIDE)."""
    lit, seen = (picture(renderer, scene, [lamp], above(), shadows=on) for on in (False, True))
    return (seen < 0.5 * lit) & (lit > 0.0)


def slanted(tangent):
    """A direction down and to the right, by that tangent."""
    return np.array([tangent, -1.0, 0.0]) / math.hypot(tangent, 1.0)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_part_casts_its_shadow_on_another_where_the_sun_throws_it(tmp_path, renderer):
    scene = slab_below_a_card(tmp_path)
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.2)), math.radians(0.5))
    lit = picture(renderer, scene, [lamp], above(), shadows=False)
    seen = picture(renderer, scene, [lamp], above())
    shaded = (seen < 0.5 * lit) & (lit > 0.0)
    columns = np.flatnonzero(shaded.any(axis=0))
    px = SIDE / 2.4
    # 0.3 to either side of 1.2 * 0.5 to the right; the card itself hides what lies below it
    assert columns[0] == pytest.approx(SIDE / 2 + 0.31 * px, abs=2.0)
    assert columns[-1] == pytest.approx(SIDE / 2 + 0.9 * px, abs=1.6)
    assert np.count_nonzero(shaded) == pytest.approx(0.59 * 0.6 * px * px, rel=0.08)
    assert seen[SIDE // 2, int(SIDE / 2 + 0.6 * px)] < 1e-3
    others = (lit > 0.0) & ~shaded
    assert np.median(np.abs(seen - lit)[others]) == 0.0


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("diameter_deg", [4.0, 12.0])
def test_the_edge_of_a_shadow_is_as_soft_as_the_lamp_is_wide(tmp_path, renderer, diameter_deg):
    scene = slab_below_a_card(tmp_path, size=0.8)
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.0)), math.radians(diameter_deg))
    lit = picture(renderer, scene, [lamp], above(), shadows=False)
    seen = picture(renderer, scene, [lamp], above())
    share = (seen / np.maximum(lit, 1e-6))[SIDE // 2 - 3 : SIDE // 2 + 3].mean(axis=0)
    px = SIDE / 2.4
    x = (np.arange(SIDE) + 0.5 - SIDE / 2) / px - 0.9  # from the shadow's right edge
    radius = math.tan(math.radians(0.5 * diameter_deg)) * 0.5 * 2.0  # tilted, it is twice as wide
    t = np.clip(x / radius, -1.0, 1.0)
    expected = (
        1.0 - (np.arccos(t) - t * np.sqrt(1.0 - t * t)) / math.pi
    )  # the disc's part that is seen
    near = (np.abs(x) < 0.2) & (x < 0.09)
    assert np.abs(share - expected)[near].mean() < 0.06
    assert np.abs(share - expected)[near].max() < 0.2


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("kind", ["point", "spot"])
def test_a_near_lamp_throws_the_shadow_away_from_itself(tmp_path, renderer, kind):
    scene = slab_below_a_card(tmp_path, size=0.4, height=1.0)
    light = Light(kind=kind, color=(1.0, 1.0, 1.0), intensity=20.0, outer_cone=1.2)
    lamp = Lamp(PosedLight(light, np.array([-0.8, 3.0, 0.0]), DOWN), math.radians(0.5))
    columns = np.flatnonzero(shaded(renderer, scene, lamp).any(axis=0))
    # the card's right edge, 1 right of the lamp and half as far below it as the slab
    assert columns[-1] == pytest.approx(SIDE / 2 + 0.7 * SIDE / 2.4, abs=1.6)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_cutout_casts_its_holes_and_glass_casts_nothing(tmp_path, renderer):
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.4)), math.radians(0.5))
    builder = GlbBuilder()
    holes = np.zeros((8, 8, 4), np.uint8)
    holes[:, :4, 3] = 255  # its left half is there
    lying(builder, 2.0, 0.0, number=material(builder))
    paint = {"baseColorTexture": {"index": builder.texture(holes, magFilter=9728)}}
    cut = material(builder, alphaMode="MASK", alphaCutoff=0.5, pbr=paint)
    lying(builder, 0.6, 0.5, number=cut, TEXCOORD_0=QUAD_UV)
    scene = Scene.load(builder.write(tmp_path / "cut.glb"))
    lit = picture(renderer, scene, [lamp], above(), shadows=False)
    dark = (picture(renderer, scene, [lamp], above()) < 0.5 * lit) & (lit > 0.0)
    columns = np.flatnonzero(dark[SIDE // 2 - 5 : SIDE // 2 + 5].any(axis=0))
    px = SIDE / 2.4
    assert columns[0] == pytest.approx(SIDE / 2 + 0.4 * px, abs=1.6)
    assert columns[-1] == pytest.approx(SIDE / 2 + 0.7 * px, abs=1.6)
    glass = slab_below_a_card(tmp_path, alpha=0.3, alphaMode="BLEND")
    one, other = (picture(renderer, glass, [lamp], above(), shadows=on) for on in (False, True))
    assert (one == other).all()


@pytest.mark.parametrize("hiding", [0.5, 0.9])
@pytest.mark.parametrize("renderer", RENDERERS)
def test_what_alpha_blends_casts_a_shadow_where_it_hides_half(tmp_path, renderer, hiding):
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.4)), math.radians(0.5))
    lit, dark = {}, {}
    for mode, alpha in (("OPAQUE", 1.0), ("BLEND", hiding)):
        scene = slab_below_a_card(tmp_path, alpha=alpha, alphaMode=mode)
        lit[mode], seen = (
            picture(renderer, scene, [lamp], above(), shadows=on) for on in (False, True)
        )
        dark[mode] = (seen < 0.5 * lit[mode]) & (lit["OPAQUE"] > 0.0)  # beside the black card
    assert np.count_nonzero(dark["OPAQUE"]) > 500
    assert np.count_nonzero(dark["OPAQUE"] ^ dark["BLEND"]) < 20


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_lamp_close_over_a_wide_slab_casts_shadows(tmp_path, renderer):
    scene = slab_below_a_card(tmp_path, size=0.2, height=0.4)
    light = Light(kind="point", color=(1.0, 1.0, 1.0), intensity=2.0)
    lamp = Lamp(PosedLight(light, np.array([-0.2, 0.6, 0.0]), DOWN), math.radians(0.5))
    columns = np.flatnonzero(shaded(renderer, scene, lamp).any(axis=0))
    # the card's right edge, 0.3 right of the lamp and 0.2 below it; the slab lies 0.6 below it
    assert columns[-1] == pytest.approx(SIDE / 2 + 0.7 * SIDE / 2.4, abs=2.0)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_what_stands_far_off_makes_no_holes_in_thin_shadows(tmp_path, renderer):
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.0)), math.radians(4.0))
    seen = {}
    for far in (0.0, 8.0):
        builder = GlbBuilder()
        white = material(builder)
        lying(builder, 2.0, 0.0, number=white)
        for z in np.linspace(-0.8, 0.7, 6):  # upright posts, which are lines from above
            quad(
                builder, (QUAD * (0.01, 0.6, 0.0) + (0.0, 0.3, 0.0)).astype(np.float32), white,
                {"rotation": [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)],
                 "translation": [-0.8, 0.0, z]},
            )  # fmt: skip
        if far:
            lying(builder, 0.5, 2.0, x=-far, number=white)
        scene = Scene.load(builder.write(tmp_path / f"{far}.glb"))
        seen[far] = picture(renderer, scene, [lamp], above())
    assert np.abs(seen[0.0] - seen[8.0]).mean() < 2.5e-3


def test_shadows_of_straight_edges_move_as_evenly_as_the_sun(tmp_path):
    scene = slab_below_a_card(tmp_path, size=0.8)
    frames = []
    for number in range(16):
        away = np.array([1.0 + 0.004 * number, -1.0, 0.3])
        lamp = Lamp(sun(np.full(3, 2.0), away / np.linalg.norm(away)), math.radians(2.0))
        frames.append(picture(SoftwareObjectRenderer, scene, [lamp], above()))
    steps = np.sqrt((np.diff(frames, axis=0) ** 2).mean(axis=(1, 2)))
    assert steps.max() < 1.6 * np.median(steps)


@pytest.mark.parametrize("seed", range(4))
def test_axes_of_a_map_turn_evenly_with_the_light(seed):
    rng = np.random.default_rng(seed)
    for _ in range(50):
        axis = rng.normal(size=3) * (1.0, 0.4, 1.0)
        axis[1] = abs(axis[1])
        axis /= np.linalg.norm(axis)
        beside = axis + 1e-4 * rng.normal(size=3)
        beside[1] = abs(beside[1])
        beside /= np.linalg.norm(beside)
        axes, others = (np.stack([*light_depth._across(one), one]) for one in (axis, beside))
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        assert np.abs(axes - others).max() < 2e-3


@pytest.mark.parametrize("renderer", RENDERERS)
def test_objects_cast_shadows_on_each_other(tmp_path, renderer):
    slab, card = GlbBuilder(), GlbBuilder()
    lying(slab, 2.0, 0.0, number=material(slab))
    lying(card, 0.6, 0.5, number=material(card))
    first, second = (
        Scene.load(one.write(tmp_path / f"{n}.glb")) for n, one in enumerate((slab, card))
    )
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.2)), math.radians(0.5))
    seen = picture(renderer, first.joined([second]), [lamp], above())
    assert seen[SIDE // 2, int(SIDE / 2 + 0.6 * SIDE / 2.4)] < 1e-3
    assert seen[SIDE // 2, int(SIDE / 2 - 0.6 * SIDE / 2.4)] > 0.1


def ball(builder, segments, smooth=True):
    """A unit sphere of quads, whose normals are those of the sphere."""
    around, up = np.meshgrid(
        np.linspace(0, 2 * np.pi, 2 * segments + 1), np.linspace(0, np.pi, segments + 1)
    )
    points = np.stack(
        [np.sin(up) * np.cos(around), np.cos(up), np.sin(up) * np.sin(around)], axis=-1
    )
    points = points.reshape(-1, 3).astype(np.float32)
    row = 2 * segments + 1
    corners = (np.arange(segments)[:, None] * row + np.arange(2 * segments)).ravel()
    faces = np.concatenate(
        [np.stack([corners, corners + 1, corners + row], axis=1),
         np.stack([corners + 1, corners + row + 1, corners + row], axis=1)]
    ).astype(np.uint32)  # fmt: skip
    builder.node(mesh=builder.mesh(points, faces, material=material(builder), NORMAL=points))


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("segments", [12, 24, 64])
def test_a_convex_body_does_not_shade_itself(tmp_path, renderer, segments):
    builder = GlbBuilder()
    ball(builder, segments)
    scene = Scene.load(builder.write(tmp_path / "ball.glb"))
    lamp = Lamp(sun(np.full(3, 2.0), slanted(1.5)))
    one, other = (picture(renderer, scene, [lamp], above(), shadows=on) for on in (False, True))
    assert np.abs(one - other).max() < 0.07  # of 0.64, where the light grazes
    assert np.abs(one - other).mean() < 3e-4


def test_maps_are_drawn_of_the_strongest_lamps_outside_of_the_object(tmp_path):
    posed = slab_below_a_card(tmp_path).pose(0.0)

    def suns(*levels):
        return [Lamp(sun(np.full(3, level), slanted(0.1 * n))) for n, level in enumerate(levels)]

    three = LightDepth.of(posed, suns(0.92, 4.0, 0.8, 3.0), 128, Opacities())
    assert three.lights == (1, 3, 0)
    assert three.shares == pytest.approx((1.0, 1.0, 0.5))
    five = LightDepth.of(posed, suns(1.0, 1.1, 1.2, 1.3, 1.4), 128, Opacities())
    assert five.lights == (4, 3, 2, 1)
    assert LightDepth.of(posed, [], 128, Opacities()) is None
    inside = Light(kind="point", color=(1.0, 1.0, 1.0), intensity=1000.0)
    lamp = Lamp(PosedLight(inside, np.array([0.2, 0.3, 0.0]), DOWN))
    assert LightDepth.of(posed, [lamp], 128, Opacities()) is None
    assert LightDepth.of(posed, [lamp, *suns(1.0)], 128, Opacities()).lights == (1,)


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_shadow_of_a_lamp_comes_evenly_as_it_grows_beside_a_stronger_one(tmp_path, renderer):
    scene, px = slab_below_a_card(tmp_path), SIDE / 2.4
    blocked = []
    levels = np.append(np.arange(0.205, 0.26, 0.005), [0.21, 0.25])
    for level in levels:
        key, weak = (
            Lamp(sun(np.full(3, light), slanted(tangent)), math.radians(0.5))
            for light, tangent in ((1.0, -1.2), (level, 1.2))
        )
        seen, lit = (picture(renderer, scene, [key, weak], above(), shadows=on) for on in (1, 0))
        spot = SIDE // 2, int(SIDE / 2 + 0.6 * px)  # in the middle of the weak lamp's shadow
        facing = 1.0 / math.hypot(1.2, 1.0)
        blocked.append((lit[spot] - seen[spot]) / (level * facing / math.pi))
    *shares, at_limit, beyond = blocked
    assert at_limit == pytest.approx(0.0, abs=2e-3)
    assert beyond == pytest.approx(shares[-1], abs=5e-3)
    shares = np.array(shares) / beyond
    assert shares[0] == 0.0
    assert np.diff(shares).min() > -5e-3
    assert np.diff(shares).max() < 0.2  # of smooth steps over 0.04 of the strongest's light


def test_maps_become_finer_as_the_camera_comes_near(tmp_path):
    posed = slab_below_a_card(tmp_path).pose(0.0)
    cameras = [replace(above(), fx=f, fy=f) for f in np.geomspace(1.0, 1e9, 500)]
    sides = [light_depth.side_for(posed, camera) for camera in cameras]
    assert (sides[0], sides[-1]) == light_depth.SIDES
    steps = [finer / coarser for coarser, finer in pairwise(sides)]
    assert min(steps) == 1.0
    assert max(steps) <= 1.25  # a larger one would be seen
    assert not any(side % light_depth.CELL for side in sides)


def random_depth(seed, far=True):
    """Maps of a few random triangles under one lamp, and points of the middle of their surfaces."""
    rng = np.random.default_rng(seed)
    builder = GlbBuilder()
    corners = rng.uniform(-1.0, 1.0, (36, 3)).astype(np.float32)
    normal = np.tile(np.float32([0, 1, 0]), (36, 1))
    faces = np.arange(36, dtype=np.uint32).reshape(-1, 3)
    builder.node(mesh=builder.mesh(corners, faces, material=material(builder), NORMAL=normal))
    toward = rng.normal(size=3)
    toward /= np.linalg.norm(toward)
    posed = sun(np.ones(3), -toward)
    if not far:
        light = Light(kind="point", color=(1.0, 1.0, 1.0), intensity=1.0)
        posed = PosedLight(light, 4.0 * toward, -toward)
    return builder, [Lamp(posed, math.radians(float(rng.uniform(0.5, 12.0))))], corners, toward, rng


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), far=st.booleans())
def test_visible_share_of_a_light_agrees_with_the_reference(tmp_path_factory, seed, far):
    builder, lamps, corners, toward, rng = random_depth(seed, far)
    posed = Scene.load(builder.write(tmp_path_factory.mktemp("s") / "s.glb")).pose(0.0)
    depth = LightDepth.of(posed, lamps, 128, Opacities())
    a, b, c = corners.reshape(-1, 3, 3).swapaxes(0, 1).astype(np.float64)
    weights = rng.dirichlet(np.ones(3), len(a))
    places = weights[:, :1] * a + weights[:, 1:2] * b + weights[:, 2:] * c
    facets = np.cross(b - a, c - a)
    facets /= np.linalg.norm(facets, axis=1, keepdims=True)
    towards = np.tile(toward, (len(a), 1)) if far else 4.0 * toward - places
    shares = np.empty(len(a), np.float32)
    rows = (one.astype(np.float32) for one in (places, facets, towards))
    kernels.visible_points(depth.maps(np.zeros(3)), 0, *rows, shares)
    expected = [
        light_depth_ref.visible(depth, 0, *one) for one in zip(places, facets, towards, strict=True)
    ]
    # a tap on the border of a pixel may fall on either side
    assert np.abs(shares - expected).max() <= 0.26
    assert np.abs(shares - expected).mean() < 0.02


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_drawn_nearness_agrees_with_the_reference(seed):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-20.0, 84.0, (30, 3)).astype(np.float32)
    faces = np.arange(30, dtype=np.int32).reshape(-1, 3)
    found = np.full((64, 64), -np.inf, np.float32)
    kernels.draw_nearness(places, faces, light_depth.SOLID, 0, 64, found)
    expected = light_depth_ref.nearness(places, faces, 64)
    same = np.isclose(found, expected, atol=1e-2)
    assert np.count_nonzero(~same) <= 4  # centres on an edge, to float32


def test_the_highest_nearness_around_each_cell_is_known(tmp_path):
    posed, lamps = slab_below_a_card(tmp_path).pose(0.0), [Lamp(sun(np.ones(3), slanted(0.5)))]
    depth, cell = LightDepth.of(posed, lamps, 320, Opacities()), light_depth.CELL
    reach = 2 * cell  # pixels, more than the largest radius of the filter
    around = np.pad(depth.nearness[0], reach, constant_values=-np.inf)
    for row, column in np.ndindex(depth.highest.shape[1:]):
        window = around[row * cell :, column * cell :][: cell + 2 * reach, : cell + 2 * reach]
        assert depth.highest[0, row, column] == window.max()


def test_depth_maps_are_the_same_at_every_level(tmp_path):
    builder, lamps, corners, toward, rng = random_depth(3)
    posed = Scene.load(builder.write(tmp_path / "s.glb")).pose(0.0)
    maps = LightDepth.of(posed, lamps, 128, Opacities()).maps(np.zeros(3))
    places = rng.uniform(-1.0, 1.0, (400, 3)).astype(np.float32)
    facets, towards = rng.normal(size=(2, 400, 3)).astype(np.float32)

    def run(module):
        drawn, shares = np.zeros((64, 64), np.float32), np.empty(400, np.float32)
        highest = np.empty((64 // light_depth.CELL,) * 2, np.float32)
        seen = (corners * 30.0 + 32.0).astype(np.float32)
        faces = np.arange(36, dtype=np.int32).reshape(-1, 3)
        module.draw_nearness(seen, faces, light_depth.SOLID, 0, 64, drawn)
        module.highest_in_cells(drawn, highest)
        module.visible_points(maps, 0, places, facets, towards, shares)
        return drawn, highest, shares

    assert_same_bits(run)


def test_depth_does_not_depend_on_what_was_drawn_before(tmp_path):
    posed, lamps = slab_below_a_card(tmp_path).pose(0.0), [Lamp(sun(np.ones(3), slanted(0.5)))]
    cache, near = light_depth.LightDepthCache(), replace(above(), fx=1e9, fy=1e9)
    first = cache.of(posed, above(), lamps)
    assert cache.of(posed, above(), lamps) is first
    assert cache.of(posed, near, lamps).nearness.shape > first.nearness.shape
    assert (cache.of(posed, above(), lamps).nearness == first.nearness).all()
