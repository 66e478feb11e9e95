"""The shadow on things whose depth is known: steps and walls, against hand-worked values."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.overhead import HEIGHT, WIDTH, looking_down

from nlens_video.core.layers import Box, DepthMap
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.distortion_apply import DistortionMap, undistorted_depth
from nlens_video.effects.shadow.cast import CastShadow
from nlens_video.effects.shadow.cast_on_things import CastOnThings
from nlens_video.effects.shadow.casters import Casters, Moment, Occluder, TransparentCaster
from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.effects.shadow.light_views import LightViews, SampledCasters
from nlens_video.effects.shadow.shadow_maps import blocked, draw
from nlens_video.effects.shadow.things import before_shadow
from nlens_video.effects.surfaces import normals
from nlens_video.render.base.opacity import Opacity
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import (
    Illumination,
    Lamp,
    Light,
    PosedLight,
    hemispheres,
    sun,
)

FRAME = Box(0, 0, WIDTH, HEIGHT)
CARD = np.array([[-0.5, 1.0, -0.5], [0.5, 1.0, -0.5], [0.5, 1.0, 0.5], [-0.5, 1.0, 0.5]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
NO_FACES = np.zeros((0, 3), np.int32)
FROM_LEFT = np.array([1.0, -1.0, 0.0]) / math.sqrt(2.0)  # a sun at 45 degrees
TOP = 10.0  # of the camera that looks down
LENS = LensFit(slope=20.0, intercept=-2.0, width=WIDTH, height=HEIGHT)


def looking_ahead():
    """A level camera 1 above the ground that looks along -Z; a unit 4 away is 25 px."""
    pose = np.eye(4)
    pose[1, 3] = 1.0
    return Camera(
        world_from_camera=pose, fx=100.0, fy=100.0, cx=WIDTH / 2, cy=HEIGHT / 2, width=WIDTH,
        height=HEIGHT,
    )  # fmt: skip


def sunlight(direction=FROM_LEFT, ambient=0.0, diameter=1e-6):
    light = np.full(3, ambient / math.pi)
    posed = sun(np.ones(3), direction / np.linalg.norm(direction))
    return Illumination((Lamp(posed, diameter),), hemispheres(light, light))


def opaque(vertices=CARD, faces=FACES):
    return Casters(np.asarray(vertices, np.float64), faces, edges_of(faces))


def cast(depth, light, camera=None, casters=None, fit=None, **given):
    """The shadows on the plane alone, and with a depth map (H, W)."""
    moments = [Moment(casters or opaque(), camera or looking_down())]
    plane = CastShadow(**given)(moments, light, 0.0, fit)
    real = DepthMap(np.asarray(depth, np.float32))
    return plane, CastOnThings(**given)(plane, moments, light, 0.0, fit, real)


def loss(shadow):
    whole = np.zeros((HEIGHT, WIDTH), np.float32)
    inside = shadow.box.intersection(FRAME)
    whole[inside.slices_in(FRAME)] = shadow.fine.loss[inside.slices_in(shadow.box)][..., 0]
    return whole


def step(height, first):
    """Depth of ground with a part raised to a height from a column on."""
    depth = np.full((HEIGHT, WIDTH), TOP)
    depth[:, first:] = TOP - height
    return depth


def dark_columns(shadow, row=60):
    return np.nonzero(loss(shadow)[row] > 0.5)[0]


def test_shadow_on_a_step_is_displaced_by_its_height():
    # Up to column 96 the ground, where the card's shadow spans 0.5 to 1.5: 90 to 110 px. Beyond,
    # 0.5 up and 9.5 before the camera, it spans 0 to 1: 80 to 101 px there.
    _, stepped = cast(step(0.5, 96), sunlight())
    columns = dark_columns(stepped)
    assert (columns.min(), columns.max() + 1) == (90, 101)
    assert len(columns) == 11 and stepped.on_things


def test_shadow_on_lower_ground_moves_on():
    # 1 down, and 11 before the camera, it spans 1.5 to 2.5: 107.3 to 125.5 px.
    plane, lower = cast(step(-1.0, 100), sunlight())
    columns = dark_columns(lower)
    assert columns[columns < 100].tolist() == list(range(90, 100))
    assert columns[columns >= 100].tolist() == list(range(107, 125))
    assert dark_columns(plane).max() + 1 == 110


@pytest.mark.parametrize("high", [1.2, 2.5])
def test_thing_between_light_and_object_stays_lit(high):
    # Where a thing stands over the card's shadow and over the card, the light meets it first.
    _, lit = cast(step(high, 85), sunlight())
    assert lit is None or loss(lit)[:, 85:].max() == 0.0


def test_shadow_climbs_a_wall():
    # A card stands at z = -2, x from -0.5 to 0.5, up to 0.62. The sun shines along (0, -1, -4):
    # on the wall at z = -4 it is 0.5 lower, so its shadow ends at 0.12 up, 0.88 below the horizon.
    card = [[-0.5, 0.0, -2.0], [0.5, 0.0, -2.0], [0.5, 0.62, -2.0], [-0.5, 0.62, -2.0]]
    light = sunlight(np.array([0.0, -1.0, -4.0]))
    view = looking_ahead()
    ground = view.plane_disparity(0.0)
    depth = np.where(ground > 0.25, 1.0 / np.maximum(ground, 0.25), 4.0)
    _, climbing = cast(depth, light, view, opaque(card))
    rows, columns = np.nonzero((loss(climbing) > 0.5) & (depth == 4.0))
    assert (columns.min(), columns.max() + 1) == (68, 92)  # 25 px wide
    assert rows.min() == 60 + 0.88 * 25 and rows.max() + 1 == 60 + 25


def test_wall_that_faces_away_from_the_sun_loses_nothing_to_a_shadow():
    card = [[-0.5, 0.3, -6.0], [0.5, 0.3, -6.0], [0.5, 0.6, -6.0], [-0.5, 0.6, -6.0]]
    depth = np.full((HEIGHT, WIDTH), 4.0)
    behind = sunlight(np.array([0.0, -0.02, 4.0]), ambient=1.0)  # towards the camera
    _, dark = cast(depth, behind, looking_ahead(), opaque(card), ambient_directions=8)
    assert dark is None or loss(dark).max() < 0.01


@pytest.mark.parametrize(
    "depth", [TOP, np.inf, 0.99 * TOP, 5 * TOP], ids=["plane", "unknown", "nearly", "backdrop"]
)
def test_without_things_the_shadow_on_the_plane_is_kept(depth):
    plane, kept = cast(np.full((HEIGHT, WIDTH), depth), sunlight(ambient=0.5))
    assert kept is plane


@pytest.mark.slow
def test_sunless_thing_beside_the_object_gets_contact_darkening():
    around = Illumination((), hemispheres(np.ones(3) / math.pi, np.ones(3) / math.pi))
    # Under the middle of a card of 1 by 1, 0.25 above, as on the ground: the usual form factor.
    part = 0.5 / math.hypot(0.5, 0.25)
    form_factor = 4.0 * part / math.pi * math.atan(part)
    low = CARD * (1.0, 0.25, 1.0) + (0.0, 0.5, 0.0)
    _, shadow = cast(
        np.full((HEIGHT, WIDTH), TOP - 0.5), around, casters=opaque(low), ambient_directions=256
    )
    assert loss(shadow)[60, 80] == pytest.approx(form_factor, abs=0.03)
    assert loss(shadow)[60, 5] == 0.0


def test_point_lamp_magnifies_the_shadow_less_on_a_table():
    lamp = Light(
        kind="point", color=(1.0, 1.0, 1.0), intensity=1.0, range=None, inner_cone=0.0,
        outer_cone=1.0,
    )  # fmt: skip
    posed = PosedLight(lamp, np.array([0.0, 3.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    light = Illumination((Lamp(posed, 1e-6),), np.zeros((9, 3)))
    plane, table = cast(np.full((HEIGHT, WIDTH), TOP - 0.5), light)
    assert len(dark_columns(plane)) == 30  # a card of 20 px, 2 below the lamp, on ground 3 below
    assert len(dark_columns(table)) == pytest.approx(25 * TOP / 9.5, abs=1)


def test_transparent_caster_leaves_a_part_of_the_light():
    vertices = np.column_stack([CARD, np.zeros((4, 2)), np.full(4, 0.4)])
    glass = TransparentCaster(vertices, FACES, Opacity(np.ones((1, 1), np.float32), (0, 0), -1.0))
    none = np.zeros((0, 4), np.int32)
    _, shadow = cast(
        step(0.5, 70), sunlight(), casters=Casters(np.zeros((0, 3)), NO_FACES, none, (glass,))
    )
    assert loss(shadow)[60, 90] == pytest.approx(0.4, abs=0.01)


def test_coc_of_the_shadow_is_that_of_the_thing():
    _, shadow = cast(step(0.5, 96), sunlight(), fit=LENS)
    row = 60 - shadow.box.y0
    coc = {column: shadow.coc_px[row, column - shadow.box.x0] for column in (92, 98)}
    assert coc[92] == pytest.approx(0.0, abs=1e-4)
    assert coc[98] == pytest.approx(20.0 / 9.5 - 2.0, abs=1e-4)


def test_shadow_on_a_thing_at_the_border_goes_on_beyond_it_where_the_lens_spreads_it():
    fit = replace(LENS, slope=0.0, intercept=12.0)
    wide = opaque(CARD * (20.0, 1.0, 20.0))
    _, shadow = cast(np.full((HEIGHT, WIDTH), TOP - 0.5), sunlight(), casters=wide, fit=fit)
    assert shadow.box.x0 <= -6 and shadow.box.y1 >= HEIGHT + 6
    assert shadow.fine.loss[:, :, 0].min() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 3])
def test_shadow_on_things_is_bit_identical_on_any_number_of_threads(threads):
    light = sunlight(ambient=0.5, diameter=0.2)
    (_, first), (_, second) = (
        cast(step(0.5, 96), light),
        cast(step(0.5, 96), light, threads=threads),
    )
    assert first.box == second.box and np.array_equal(first.loss, second.loss)


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_what_a_point_of_a_light_blocks_agrees_with_rays(seed):
    """Every triangle is met or missed by every ray to the light, but for rays along its edges."""
    rng = np.random.default_rng(seed)
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    vertices = rng.uniform((-1, 0.2, -1), (1, 1, 1), (9, 3))
    far = rng.random() < 0.5
    toward = rng.normal(size=3) * (1, 0.5, 1) + (0, 1.5, 0)
    light = np.append(toward / np.linalg.norm(toward) * (1.0 if far else 6.0), 0.0 if far else 1.0)
    # beyond the casters, as the light sees them
    middle = np.array([0.0, 0.6, 0.0])
    toward = light[:3] - light[3] * middle
    beyond = middle - 6.0 * toward / np.linalg.norm(toward)
    points = (beyond + rng.normal(size=(400, 3))).astype(np.float32)
    occluder = Occluder.of(opaque(vertices, faces), looking_down(), 0.0)
    views = LightViews.of(light[None], range(1), SampledCasters.of(occluder), 0.004)
    found = blocked(draw([views]), points)[0] > 0.5
    met, close = _met(points.astype(float), light, vertices[faces])
    assert (found == met)[~close].all()


def _met(points, light, triangles):
    """Which rays from points to a light meet a triangle, and which pass near an edge."""
    rays = light[:3] - light[3] * points
    met, close = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for a, b, c in triangles:
        for number, (point, ray) in enumerate(zip(points, rays, strict=True)):
            try:
                share = np.linalg.solve(np.column_stack([b - a, c - a, -ray]), point - a)
            except np.linalg.LinAlgError:
                close[number] = True
                continue
            corner = min(share[0], share[1], 1.0 - share[0] - share[1])
            sine = abs(np.linalg.det(np.column_stack([b - a, c - a, ray])))
            sine /= np.linalg.norm(ray) * np.linalg.norm(b - a) * np.linalg.norm(c - a)
            met[number] |= corner > 0.0 and share[2] > 0.0
            close[number] |= abs(corner) < 0.1 or sine < 0.15
    return met, close


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_normals_of_planes_are_found_up_to_an_edge(seed):
    rng = np.random.default_rng(seed)
    view = replace(looking_ahead(), width=60, height=40, cx=30.0, cy=20.0)
    rays = np.stack(
        np.broadcast_arrays(
            (np.arange(60) + 0.5 - 30) / 100, -(np.arange(40)[:, None] + 0.5 - 20) / 100, -1.0
        ),
        axis=-1,
    )
    two = rng.normal(size=(2, 3)) * (1, 1, 0.3) + (0, 0, 1.5)
    two /= np.linalg.norm(two, axis=1, keepdims=True)
    disparity = -(rays @ two.T) / np.array([3.0, 5.0])  # planes at these distances
    seen = np.where(np.arange(60) < 25, disparity[..., 0], disparity[..., 1])
    found = normals(seen.astype(np.float32), view)
    wanted = np.where(np.arange(60)[:, None] < 25, two[0], two[1]) + np.zeros((40, 1, 1))
    assert np.linalg.norm(found, axis=-1) == pytest.approx(1.0, abs=1e-5)
    assert found[4:-4, 4:-4] == pytest.approx(wanted[4:-4, 4:-4], abs=0.02)


def test_thing_before_the_object_hides_the_shadow_behind_it_unless_it_falls_on_it():
    surface = looking_down().plane_disparity(0.0).astype(np.float32)
    _, shadow = cast(step(0.5, 96), sunlight())
    post = step(0.5, 96)
    post[:, 5:15] = 3.0  # nearer than the object, and in the light
    hides = before_shadow(DepthMap(post.astype(np.float32)), surface, 9.0, shadow)
    assert np.isfinite(hides.depth[:, 5:15]).all() and np.isinf(hides.depth[:, 15:]).all()
    post[:, 97] = 3.0
    shaded = before_shadow(DepthMap(post.astype(np.float32)), surface, 9.0, shadow)
    assert np.isinf(shaded.depth).all()


def test_depth_of_a_distorted_plate_is_looked_up_where_the_lens_shows_it():
    warp = DistortionMap.of(Distortion(k1=-0.2, k2=0.0), looking_down())
    depth = np.tile(np.arange(WIDTH, dtype=np.float32), (HEIGHT, 1))
    ideal = undistorted_depth(DepthMap(depth), warp).depth
    across, _ = warp.distorted(np.array([20.5]), np.array([30.5]))
    assert ideal[30, 20] == pytest.approx(across[0] - 0.5, abs=0.51)
    assert ideal[60, 80] == pytest.approx(80, abs=1)
    pincushion = DistortionMap.of(Distortion(k1=0.2, k2=0.0), looking_down())
    assert np.isinf(undistorted_depth(DepthMap(depth), pincushion).depth[0, 0])
