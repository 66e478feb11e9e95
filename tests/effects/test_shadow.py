"""Ground shadow: position, density, blur and reach against hand-worked values."""

import itertools
import math
import tracemalloc

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support import shots
from support.definitions import marked
from support.overhead import HEIGHT, WIDTH, looking_down

from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.shadow.ambient import (
    blurred,
    from_around,
    hemisphere,
    surface_points,
)
from nlens_video.effects.shadow.apply import ApplyShadow, Grid, Shadow
from nlens_video.effects.shadow.blocked import Query, hidden_shares, reached
from nlens_video.effects.shadow.cast import BLACKEST, CastShadow
from nlens_video.effects.shadow.casters import (
    CasterCache,
    Casters,
    ClippedMesh,
    Moment,
    Occluder,
)
from nlens_video.effects.shadow.coverage import PER_PIXEL, covered_reference, edges_of
from nlens_video.effects.shadow.light_samples import project_along_light
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import (
    Illumination,
    Lamp,
    Light,
    PosedLight,
    from_lamp,
    hemispheres,
    sun,
)
from nlens_video.scene.object_motion import turned_about_up
from nlens_video.scene.scene import Scene
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.pixels.picture import ArrayPicture

CARD = np.array([[-0.5, 1.0, -0.5], [0.5, 1.0, -0.5], [0.5, 1.0, 0.5], [-0.5, 1.0, 0.5]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
DOWN = np.array([1.0, -1.0, 0.0]) / math.sqrt(2.0)  # a sun at 45 degrees, from the left
GREY = np.array([1.0, 1.0, 1.0])
FRAME = Box(0, 0, WIDTH, HEIGHT)
NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")  # of a camera, in pixels


def of_sun(ambient=0.0, direction=DOWN, diameter=1e-6):
    """A sun of irradiance 1 on the ground, and light from around of irradiance `ambient`."""
    posed = sun(GREY / -direction[1], direction)
    light = np.full(3, ambient / math.pi)
    return Illumination((Lamp(posed, diameter),), hemispheres(light, light))


def loss(shadow):
    """The loss on the whole frame (h, w, 3)."""
    whole = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    inside = shadow.box.intersection(FRAME)
    whole[inside.slices_in(FRAME)] = shadow.loss[inside.slices_in(shadow.box)]
    return whole


def cast(light, camera=None, fit=None, vertices=CARD, **given):
    casters = Casters(vertices, FACES, edges_of(FACES))
    moment = Moment(casters, camera or looking_down())
    return CastShadow(**given)([moment], light, 0.0, fit)


def test_shadow_of_an_unsure_lamp_is_the_mean_of_those_that_it_may_cast():
    turns = np.radians(np.linspace(-60.0, 60.0, 72))
    posed, broad = sun(GREY / -DOWN[1], DOWN), math.radians(12.0)
    rest = hemispheres(GREY / math.pi, GREY / math.pi)
    one = Illumination((Lamp(posed, broad, turns),), rest)
    each = [
        Illumination((Lamp(replace(posed, direction=turned_about_up(DOWN, turn)), broad),), rest)
        for turn in turns[::3]
    ]
    found, expected = loss(cast(one)), np.mean([loss(cast(other)) for other in each], axis=0)
    assert expected.max() > 0.15
    assert np.abs(found - expected).mean() < 0.02 * expected[expected > 0.0].mean()
    assert np.abs(found - expected).max() < 0.06


def test_shadow_of_a_lamp_on_any_side_shows_no_pattern_of_its_samples():
    """A round thing under a sun of any azimuth: its shadow is as dark in all directions."""
    ring = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
    rim = np.stack([0.4 * np.cos(ring), np.full(48, 0.8), 0.4 * np.sin(ring)], axis=1)
    vertices = np.concatenate([rim, [[0.0, 0.8, 0.0]]])
    faces = np.array([[n, (n + 1) % 48, 48] for n in range(48)], np.int32)
    turns = 2.0 * math.pi * ((np.arange(72) + 0.5) / 72 - 0.5)
    lamp = Lamp(sun(GREY / -DOWN[1], DOWN), math.radians(12.0), turns)
    light = Illumination((lamp,), hemispheres(np.zeros(3), np.zeros(3)))
    moment = Moment(Casters(vertices, faces, edges_of(faces)), looking_down())
    shadow = loss(CastShadow()([moment], light, 0.0, None))[..., 0]
    centre = looking_down().pixels(looking_down().to_camera(np.zeros((1, 3))))[0]
    row, column = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    away = np.hypot(column - centre[0], row - centre[1])
    around = shadow[np.abs(away - 20.0 * 0.8) < 1.0]  # at the middle of each sample's shadow
    assert around.mean() > 0.05
    assert around.std() < 0.1 * around.mean()


def test_shadow_of_an_unsure_lamp_may_lie_out_of_view():
    """A low sun casts it beyond the frame; contact darkening under the card stays."""
    low = np.array([1.0, -0.05, 0.0]) / math.hypot(1.0, 0.05)
    turns = np.radians(np.linspace(-5.0, 5.0, 24))
    around = hemispheres(GREY / math.pi, GREY / math.pi)
    light = Illumination((Lamp(sun(GREY, low), 0.01, turns),), around)
    close = CARD * (1.0, 0.5, 1.0)
    found = loss(cast(light, vertices=close))[..., 0]
    alone = loss(cast(Illumination((), around), vertices=close))[..., 0]
    given = from_lamp(light.lamps[0], np.zeros(3))[0]
    np.testing.assert_allclose(found, alone / (1.0 + given), atol=1e-3)
    assert found.max() > 0.1


def test_ground_gets_as_much_of_a_lamp_wherever_it_may_stand():
    lamp = Lamp(sun(GREY, DOWN), 0.1, np.radians(np.linspace(-180.0, 180.0, 72)))
    np.testing.assert_allclose(from_lamp(lamp, np.zeros(3)), GREY * -DOWN[1])
    # a wall gets the mean of the lamps of all azimuths
    wall = from_lamp(lamp, np.zeros(3), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(wall, GREY * math.sqrt(0.5) / math.pi, rtol=0.03)


def test_shadow_under_a_sun_at_45_degrees_is_displaced_by_the_height():
    dark = loss(cast(of_sun()))[..., 0] > 0.5
    rows, columns = np.nonzero(dark)
    # The card spans x -0.5 to 0.5 at height 1: its shadow spans 0.5 to 1.5, that is 90 to 110 px.
    assert (columns.min(), columns.max() + 1) == (90, 110)
    assert (rows.min(), rows.max() + 1) == (50, 70)
    assert dark[50:70, 90:110].all()


def test_ambient_light_remains_in_the_shadow():
    # Ten units up and 0.1 wide, the card hides next to nothing of what comes from around.
    high = CARD * (0.1, 10, 0.1) - (10.0, 0.0, 0.0)
    assert loss(cast(of_sun(ambient=0.25), vertices=high))[60, 80] == pytest.approx(0.8, abs=0.01)


def test_each_colour_channel_loses_its_own_share_of_light():
    red = PosedLight(
        Light(
            kind="directional", color=(1.0, 0.5, 0.0), intensity=math.sqrt(2.0), range=None,
            inner_cone=0.0, outer_cone=1.0,
        ),
        np.zeros(3),
        DOWN,
    )  # fmt: skip
    around = hemispheres(GREY / math.pi, GREY / math.pi)
    shadow = cast(Illumination((Lamp(red, 1e-6),), around))
    red_loss, green_loss, contact = loss(shadow)[52, 107]  # blue comes from around only
    assert red_loss == pytest.approx((1.0 + contact) / 2.0, abs=1e-3)
    assert green_loss == pytest.approx((0.5 + contact) / 1.5, abs=1e-3)
    assert contact < 0.2


def test_larger_lamp_gives_a_wider_penumbra():
    def edge(diameter):
        row = loss(cast(of_sun(diameter=diameter), lamp_points=64))[60, :, 0]
        return int(((row > 0.05) & (row < 0.95)).sum())

    assert edge(1e-6) <= 2
    # Seen from 1.41 away, 0.4 rad are 0.57 wide across, on the slanting ground 0.8, each side.
    assert 24 <= edge(0.4) <= 36


def test_point_light_magnifies_the_shadow():
    lamp = Light(
        kind="point", color=(1.0, 1.0, 1.0), intensity=1.0, range=None, inner_cone=0.0,
        outer_cone=1.0,
    )  # fmt: skip
    posed = PosedLight(lamp, np.array([0.0, 2.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    light = Illumination((Lamp(posed, 1e-6),), np.zeros((9, 3)))
    columns = np.nonzero(loss(cast(light))[60, :, 0] > 0.5)[0]
    assert (columns.min(), columns.max() + 1) == (60, 100)  # twice the card
    at = np.array([0.0, 0.0, 0.0])
    assert from_lamp(Lamp(posed), at) == pytest.approx(GREY / 4.0)
    aside = np.array([2.0, 0.0, 0.0])
    assert from_lamp(Lamp(posed), aside) == pytest.approx(GREY * math.sqrt(0.5) / 8.0)


def lamp_at(*place, kind="point", color=(1.0, 1.0, 1.0), reach=None):
    """A lamp of an intensity of 3 that shines down."""
    light = Light(kind=kind, color=color, intensity=3.0, range=reach, outer_cone=1.0)
    return Lamp(PosedLight(light, np.array(place), np.array([0.0, -1.0, 0.0])), 1e-6)


def given_by(lamp, x, z):
    """Irradiance of a point of the ground by a lamp, as glTF defines it: (3,)."""
    light = lamp.posed.light
    across, height, along = (float(one) for one in lamp.posed.position - (x, 0.0, z))
    distance = math.sqrt(across**2 + height**2 + along**2)
    cosine = height / distance
    found = cosine / distance**2
    if light.range is not None:
        found *= min(max(1.0 - (distance / light.range) ** 4, 0.0), 1.0)
    if light.kind == "spot":
        found *= min(max((cosine - math.cos(1.0)) / (1.0 - math.cos(1.0)), 0.0), 1.0) ** 2
    return found * light.intensity * np.array(light.color)


def test_each_of_many_lamps_is_lost_where_its_own_shadow_falls():
    lamps = (
        lamp_at(-1.5, 2.0, 0.3), lamp_at(1.0, 2.5, -1.0, color=(1.0, 0.5, 0.2)),
        lamp_at(0.2, 1.8, 0.0, kind="spot"), lamp_at(2.0, 3.0, 1.0, reach=4.5),
    )  # fmt: skip
    found = loss(cast(Illumination(lamps, np.zeros((9, 3)))))
    alone = np.array([loss(cast(Illumination((one,), np.zeros((9, 3)))))[..., 0] for one in lamps])
    shares = np.where(alone < BLACKEST, alone, 1.0)  # alone, a lamp is all that is lost
    ground = looking_down().plane_points(0.0)
    for row, column in itertools.product(range(0, HEIGHT, 7), range(0, WIDTH, 7)):
        x, _, z = ground[row, column]
        each = np.array([given_by(one, x, z) for one in lamps])
        expected = np.minimum(shares[:, row, column] @ each / each.sum(axis=0), BLACKEST)
        np.testing.assert_allclose(found[row, column], expected, rtol=1e-5, atol=1e-6)
    assert (shares.max(axis=(1, 2)) == 1.0).all()


def test_lamps_share_what_a_shadow_takes_of_memory():
    """Of each more lamp there is the blocked share at each pixel, not the light in each channel."""

    def most(count):
        lamps = tuple(lamp_at(0.01 * n, 1.2, 0.0) for n in range(count))
        light = Illumination(lamps, np.zeros((9, 3)))
        tracemalloc.start()
        pixels = cast(light, lamp_points=1, threads=1).loss[..., 0].size
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak, pixels

    few, pixels = most(4)
    many, _ = most(24)
    assert pixels > 10_000
    assert many - few < 20 * 12 * pixels


def test_missing_ambient_light_is_assumed_to_make_the_total_white():
    posed = sun(np.array([2.0, 1.0, 0.5]), np.array([0.0, -1.0, 0.0]))
    light = Illumination((Lamp(posed),), None)
    total = from_around(light, np.zeros(3)) + [2.0, 1.0, 0.5]
    assert total == pytest.approx(np.full(3, total[0]))
    # Where a second lamp gives as much, the file tells all light, and nothing is assumed.
    both = Illumination((Lamp(posed), Lamp(posed)), None)
    assert not from_around(both, np.zeros(3)).any()


@pytest.mark.parametrize(
    "light",
    [
        Illumination((), np.zeros((9, 3))),
        of_sun(direction=np.array([0.6, 0.8, 0.0])),
        of_sun(direction=np.array([1.0, 0.0, 0.0]) + [0, 1e-9, 0]),
    ],
    ids=["no light", "from below", "level"],
)
def test_no_light_on_the_ground_casts_no_shadow(light):
    assert cast(light) is None


def test_shadow_strength_scales_the_loss_and_zero_disables_it():
    full, half = (loss(cast(of_sun(ambient=1.0), strength=s)) for s in (1.0, 0.5))
    assert half == pytest.approx(0.5 * full, abs=1e-6)
    assert cast(of_sun(), strength=0.0) is None


def test_no_shadow_above_the_horizon_or_from_below_the_ground():
    pose = np.eye(4)
    pose[1, 3] = 1.0  # level, 1 above the ground: the horizon is the middle row
    camera = Camera(
        world_from_camera=pose, fx=100.0, fy=100.0, cx=WIDTH / 2, cy=HEIGHT / 2,
        width=WIDTH, height=HEIGHT,
    )  # fmt: skip
    wide = CARD * (100, 1, 1000) + (0, 0, -503)
    seen = loss(cast(of_sun(), camera, vertices=wide))
    assert seen[: HEIGHT // 2].max() == 0.0 and seen[HEIGHT // 2 + 2 :].max() > 0.5
    pose[1, 3] = -1.0
    assert cast(of_sun(), camera, vertices=wide) is None


def test_geometry_below_the_ground_casts_no_shadow():
    wall = np.array([[0.0, -1.0, -0.5], [0.0, -1.0, 0.5], [0.0, 1.0, 0.5], [0.0, 1.0, -0.5]])
    sunk = ClippedMesh.above(wall, FACES, edges_of(FACES), 0.0)
    used = sunk.vertices[sunk.faces.ravel()]
    assert used[:, 1].min() == pytest.approx(0.0) and used[:, 1].max() == 1.0
    corners = sunk.vertices[sunk.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * np.linalg.norm(cross, axis=1).sum() == pytest.approx(1.0)  # half of its area
    columns = np.nonzero(loss(cast(of_sun(), vertices=wall))[60, :, 0] > 0.5)[0]
    assert (columns.min(), columns.max() + 1) == (80, 100)


def test_vertices_just_below_the_ground_are_raised_and_deeper_ones_clipped():
    wall = np.array([[0.0, -9e-4, -0.5], [0.0, -9e-4, 0.5], [0.0, 1.0, 0.5], [0.0, 1.0, -0.5]])
    raised = ClippedMesh.above(wall, FACES, edges_of(FACES), 0.0)
    assert raised.faces is FACES and raised.vertices[:, 1].min() == 0.0
    sunk = ClippedMesh.above(wall * (1.0, 2.0, 1.0) - (0.0, 1e-3, 0.0), FACES, edges_of(FACES), 0.0)
    assert len(sunk.faces) > 2 and sunk.vertices[sunk.faces.ravel(), 1].min() == 0.0


def linear(codes):
    """Light of display codes from 0 to 1."""
    return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)


def darkened(plate, shadow, *, round_lens=False):
    picture = plate.copy()
    stage = ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach), round_lens=round_lens)
    stage(ArrayPicture(picture), shadow, FRAME)
    return picture


def test_plate_is_multiplied_in_the_shadow_and_bit_identical_outside():
    plate = np.random.default_rng(1).integers(180, 250, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    shadow = cast(of_sun(ambient=1.0))
    after = darkened(plate, shadow)
    gone = loss(shadow)
    assert np.array_equal(after[gone.max(axis=2) == 0], plate[gone.max(axis=2) == 0])

    assert linear(after / 255.0) == pytest.approx(linear(plate / 255.0) * (1.0 - gone), abs=0.005)


def test_shadow_is_blurred_by_the_grounds_coc_and_keeps_its_energy():
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    fit = LensFit(slope=0.0, intercept=-12.0, width=WIDTH, height=HEIGHT)
    sharp, blurred = darkened(plate, cast(of_sun())), darkened(plate, cast(of_sun(), fit=fit))
    lost = [(linear(plate) - linear(after)).sum() for after in (sharp, blurred)]
    assert lost[1] == pytest.approx(lost[0], rel=0.02)
    half = np.nonzero(blurred[60, :, 0] < 0.499)[0]
    assert (90 - 8) <= half.min() <= (90 - 4) and (110 + 3) <= half.max() <= (110 + 7)


@pytest.mark.parametrize("coc_px", [0.0, 0.7, 5.0, 17.0, 60.0, 200.0])
def test_round_lens_blurs_a_shadow_on_the_plane_as_any_other(coc_px):
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    fit = LensFit(slope=0.0, intercept=coc_px, width=WIDTH, height=HEIGHT)
    shadow = cast(of_sun(ambient=0.5, diameter=0.2), fit=fit)
    lean = 0.05 * shadow.step * np.arange(len(shadow.coc_px), dtype=np.float32)[:, None]
    shadow = replace(shadow, coc_px=shadow.coc_px + lean)
    any_lens, of_disc = (darkened(plate, shadow, round_lens=given) for given in (False, True))
    assert any_lens.min() < 0.498
    assert of_disc == pytest.approx(any_lens, abs=1.5 / 255)


def test_defocused_shadow_beside_the_frame_reaches_into_it():
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    beside = CARD + (3.6, 0.0, 0.0)  # its shadow begins 2 px to the right of the frame
    assert cast(of_sun(), vertices=beside) is None
    fit = LensFit(slope=0.0, intercept=12.0, width=WIDTH, height=HEIGHT)
    after = darkened(plate, cast(of_sun(), fit=fit, vertices=beside))
    assert (after[60, -3:] < 0.499).all() and (after[60, :-12] == 0.5).all()


@pytest.mark.parametrize("round_lens", [False, True])
@pytest.mark.parametrize("step", [1, 2, 4])
@pytest.mark.parametrize("coc_px", [0.0, 12.0, 20.0])
def test_shadow_whose_blur_ends_beside_the_frame_leaves_the_plate(coc_px, step, round_lens):
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    for x0, y0 in ((-64, 0), (0, -64), (WIDTH + 32, 0), (0, HEIGHT + 32)):
        box = Box(x0, y0, x0 + 32, y0 + 32)
        size = (32 // step, 32 // step)
        shadow = Shadow(
            box=box, loss=np.full((*size, 3), 0.5, np.float32),
            coc_px=np.full(size, coc_px, np.float32), step=step,
        )  # fmt: skip
        assert np.array_equal(darkened(plate, shadow, round_lens=round_lens), plate)
    nothing = np.zeros((0, 0, 3), np.float32)
    shadow = Shadow(box=Box(0, 0, 0, 0), loss=nothing, coc_px=nothing[..., 0], step=step)
    assert np.array_equal(darkened(plate, shadow, round_lens=round_lens), plate)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_shadow_is_bit_identical_on_any_number_of_threads(threads):
    light = of_sun(ambient=0.5, diameter=0.2)
    first, second = cast(light), cast(light, threads=threads)
    assert first.box == second.box and np.array_equal(first.loss, second.loss)


def test_shadow_on_defocused_ground_is_cast_at_lower_resolution_without_difference():
    plate = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    light = of_sun(ambient=0.5, diameter=0.2)
    fit = LensFit(slope=0.0, intercept=17.0, width=WIDTH, height=HEIGHT)
    coarse = cast(light, fit=fit, lamp_points=64)
    assert coarse.step == 4 and cast(light).step == 1
    whole = cast(light, lamp_points=64)
    fine = Shadow(box=whole.box, loss=whole.loss, coc_px=np.full_like(whole.coc_px, 17.0))
    assert darkened(plate, coarse) == pytest.approx(darkened(plate, fine), abs=3.0 / 255)
    assert coarse.fine.loss.sum() == pytest.approx(fine.loss.sum(), rel=0.02)


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_triangle_coverage_agrees_with_the_reference_even_behind_the_camera(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(9, 3)) * (30, 30, 1) + (10, 10, 0.5)
    faces = np.arange(9, dtype=np.int32).reshape(3, 3)
    size, at = (17, 23), (0.3, 0.7)
    # places are rounded: a pixel counts where the definition is sure all around it
    little = 1.0 / PER_PIXEL
    around = [
        covered_reference(size, points, faces, (at[0] + dx, at[1] + dy))
        for dx in (-little, 0.0, little)
        for dy in (-little, 0.0, little)
    ]
    found = marked(size, points, faces, at)
    assert (found | ~np.all(around, axis=0)).all() and (~found | np.any(around, axis=0)).all()


def test_coverage_of_folded_meshes_with_holes_equals_the_reference():
    rng = np.random.default_rng(7)
    x, y = np.meshgrid(np.linspace(4, 60, 12), np.linspace(4, 40, 9))
    rough = np.column_stack([x.ravel(), y.ravel()]) + rng.normal(size=(108, 2)) * 4.0  # folds over
    points = np.column_stack([np.round(rough * PER_PIXEL) / PER_PIXEL + 0.001, np.ones(108)])
    number = np.arange(108).reshape(9, 12)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:],
                                            number[1:, :-1]))  # fmt: skip
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    faces = faces[rng.permutation(len(faces))[:150]]  # with holes
    turned = rng.random(len(faces)) < 0.3  # and faces that turn the other way
    faces[turned] = faces[turned][:, ::-1]
    at = (0.501, 0.501)  # places are whole parts of a pixel from here: nothing is rounded
    assert np.array_equal(
        marked((44, 64), points, faces, at), covered_reference((44, 64), points, faces, at)
    )
    assert len(edges_of(faces)) < 3 * len(faces)


BODY = np.array([[x, y, z] for x in (-0.4, 0.3) for y in (0.0, 1.1) for z in (-3.6, -2.9)])
FORWARD = Camera(
    fx=900.0, fy=900.0, cx=540.0, cy=500.0, width=1080, height=1920,
    world_from_camera=np.eye(4) + np.outer([0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.4]),
)  # fmt: skip
PORTRAIT = Box(0, 0, FORWARD.width, FORWARD.height)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_reach_of_a_shadow_bounds_it_also_where_it_passes_below_the_camera(seed):
    rng = np.random.default_rng(seed)
    lights = np.column_stack([rng.normal(size=(6, 3)), np.zeros(6)])
    lights[:, 1] = np.abs(lights[:, 1]) * rng.choice([0.03, 1.0], 6)
    occluder = Occluder.of(Casters(BODY, FACES, edges_of(FACES)), FORWARD, 0.0)
    box = reached(occluder, lights, PORTRAIT)
    points = np.column_stack([rng.uniform(BODY.min(0), BODY.max(0), (4000, 3)), np.ones(4000)])
    places = points @ project_along_light(lights, 0.0, FORWARD).swapaxes(1, 2)
    column, row = (places[..., :2] / places[..., 2:]).reshape(-1, 2)[places[..., 2].ravel() > 0].T
    seen = (column >= 0) & (column < PORTRAIT.x1) & (row >= 0) & (row < PORTRAIT.y1)
    assert ((column >= box.x0) & (column <= box.x1))[seen].all()
    assert ((row >= box.y0) & (row <= box.y1))[seen].all()


def test_shadow_towards_the_camera_reaches_no_ground_beyond_the_body():
    low = np.array([[0.05, 0.05, -1.0, 0.0]])  # its shadow passes the camera, 1.4 above the ground
    occluder = Occluder.of(Casters(BODY, FACES, edges_of(FACES)), FORWARD, 0.0)
    box = reached(occluder, low, PORTRAIT)
    farthest = 500.0 + 900.0 * 1.4 / 3.6  # row of the ground below the body's far side
    assert (box.y0, box.y1) == (pytest.approx(farthest, abs=1.0), PORTRAIT.y1)


def test_lamps_drawn_together_block_what_each_blocks_alone():
    rng = np.random.default_rng(1)
    lights = [
        np.column_stack([rng.uniform(-0.5, 0.5, (count, 3)) + (0.0, height, 0.0), np.zeros(count)])
        for count, height in ((7, 1.0), (5, 0.4), (9, 1.0))  # some from below the ground
    ]
    one = Occluder.of(Casters(CARD, FACES, edges_of(FACES)), looking_down(), 0.0)
    other = Occluder.of(Casters(CARD + 0.3, FACES, edges_of(FACES)), looking_down(), 0.0)
    together = [Query(own, len(own), grid) for grid in [Grid.on(FRAME, 1)] for own in lights]
    found = hidden_shares([one, None, other], together, 2)
    for query, share in zip(together, found, strict=True):
        alone = Query(query.lights, query.count, Grid.on(FRAME, 1))
        assert share.max() > 0.1
        assert np.array_equal(share, hidden_shares([one, None, other], [alone], 1)[0])


@pytest.mark.needs_truth
@pytest.mark.parametrize(("scene", "gain_db"), [("street_mid", 6.0), ("indoor_mid", 5.0)])
def test_shadow_agrees_with_a_path_tracer(shared, scene, gain_db):
    from nlens_video.scene.scene_light import SceneLight

    folder = shared / "data" / "cycles" / "dev" / scene
    loaded = Scene.load(folder / "object.glb")
    posed = loaded.pose(0.0)
    without, truth = (cv2.imread(str(folder / f"{n}.png")) for n in ("gt_noshadow", "gt"))
    camera = loaded.camera(0.0, 960, 512)
    light = SceneLight(loaded.light_count).on_ground(posed.lights)
    shadow = CastShadow()([Moment(Casters.of(posed, CasterCache()), camera)], light, 0.0, None)
    picture = without.copy()
    frame = Box(0, 0, 960, 512)
    ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))(
        ArrayPicture(picture), shadow, frame
    )
    body = cv2.imread(str(folder / "object_rgba.png"), cv2.IMREAD_UNCHANGED)[..., 3] > 0
    away = cv2.dilate(body.astype(np.uint8), np.ones((41, 41))) == 0
    mean = [cv2.blur(p.astype(np.float32), (5, 5)).sum(axis=2) + 1.0 for p in (truth, without)]
    region = away & (mean[0] / mean[1] < 0.9) & (camera.plane_disparity(0.0) > 0)

    def error(result):
        return float(((result[region].astype(float) - truth[region]) ** 2).mean())

    assert 10.0 * math.log10(error(without) / error(picture)) >= gain_db


def test_visible_contact_darkening_is_the_whole_share_of_light_that_is_blocked():
    # Under the middle of a card of 1 by 1, 0.25 above: its form factor by the usual formula.
    low = CARD * (1.0, 0.25, 1.0)
    part = 0.5 / math.hypot(0.5, 0.25)
    form_factor = 4.0 * part / math.pi * math.atan(part)
    around = hemispheres(GREY / math.pi, GREY / math.pi)
    shown = loss(cast(Illumination((), around), vertices=low, ambient_directions=1024))
    assert shown[60, 80] == pytest.approx(form_factor, abs=0.02)


def test_contact_of_light_is_a_factor_on_its_darkening():
    light = Illumination((), hemispheres(GREY / math.pi, GREY / math.pi))
    whole, part = (loss(cast(one)) for one in (light, replace(light, contact=0.5)))
    assert part == pytest.approx(0.5 * whole, abs=1e-6)
    assert whole.max() > 0.2


def test_contact_darkening_of_a_small_thing_is_as_deep_as_that_of_a_large_one():
    around = Illumination((), hemispheres(GREY / math.pi, GREY / math.pi))
    foot = CARD * (0.3, 0.08, 0.3)  # 6 pixels wide
    seen = looking_down()
    near = replace(seen, **{name: 8 * getattr(seen, name) for name in NUMBERS})
    small = loss(cast(around, vertices=foot))[60, 80, 0]
    large = cast(around, camera=near, vertices=foot)
    row, column = 480 - large.box.y0, 640 - large.box.x0
    deep = large.fine.loss[row - 4 : row + 4, column - 4 : column + 4, 0].mean()
    assert small == pytest.approx(deep, abs=0.06)


def test_contact_darkening_shows_no_pattern_of_its_directions():
    around = hemispheres(GREY / math.pi, GREY / math.pi)
    few, many = (
        loss(cast(Illumination((), around), ambient_directions=count))[..., 0]
        for count in (32, 2048)
    )
    # The card hides at most the part of the sky under which it is seen from the ground.
    assert 0.2 < many.max() < 0.4
    assert np.abs(few - many).max() < 0.05

    def roughness(shadow):
        return float(np.abs(np.diff(shadow, n=2, axis=1)).max())

    assert roughness(few) < 2.0 * roughness(many) + 1e-3


def test_samples_of_the_sky_are_denser_where_it_is_brighter():
    even = hemisphere(256, hemispheres(GREY, GREY))
    assert even == pytest.approx(hemisphere(256), abs=1e-6)
    bright = hemispheres(GREY, GREY)
    bright[3] = 0.5  # towards +X
    toward = hemisphere(256, bright)
    assert toward[:, 0].mean() > even[:, 0].mean() + 0.1
    assert np.linalg.norm(toward, axis=1) == pytest.approx(1.0)


def test_points_of_a_surface_lie_on_it_evenly():
    points = surface_points(CARD, FACES)
    spread = points[: -len(CARD)]
    assert (spread[:, 1] == 1.0).all() and np.abs(spread[:, [0, 2]]).max() <= 0.5
    assert np.histogram(spread[:, 0], 4, (-0.5, 0.5))[0] == pytest.approx(len(spread) / 4, rel=0.3)


@pytest.mark.parametrize("slant", [0.1, 1.0])
@pytest.mark.parametrize("octave", range(1, 8))
def test_share_blurred_on_coarser_pixels_is_that_of_the_plain_filter(octave, slant):
    hidden = np.zeros((173, 301), np.float32)
    hidden[40:90, 60:200], hidden[100:, 250:], hidden[:30, :50] = 0.8, 0.5, 1.0
    found = blurred(hidden, np.full(hidden.shape, octave, np.float32), slant)
    sigma = 0.7 * 2.0 ** (octave - 1)
    plain = cv2.GaussianBlur(
        hidden,
        (0, 0),
        sigmaX=sigma,
        sigmaY=max(sigma * slant, 0.05),
        borderType=cv2.BORDER_REPLICATE,
    )
    assert np.abs(found - plain).max() < 3e-3
    assert np.sqrt(np.square(found - plain).mean()) < 5e-4


def test_casters_are_made_again_only_where_the_object_has_moved(tmp_path):
    scene = Scene.load(shots.cube_glb(tmp_path / "cube.glb", end=(0.5, 0.0, -1.6)))
    cache = CasterCache()
    moving, further, rests = (Casters.of(scene.pose(time_s), cache) for time_s in (0.5, 1.0, 2.0))
    assert further is rests and moving is not further
    assert np.ptp(further.vertices - moving.vertices, axis=0) == pytest.approx(0.0, abs=1e-6)
    assert (further.vertices - moving.vertices)[0] == pytest.approx([0.25, 0.0, 0.0], abs=1e-6)
