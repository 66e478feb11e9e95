"""Light that the object sends back to the ground, against closed forms and plain expectations."""

import math

import numpy as np
import pytest
from support.overhead import HEIGHT, WIDTH, looking_down

from nlens_video.core.layers import Box
from nlens_video.effects.shadow.bounce import bounce, sent_light
from nlens_video.effects.shadow.cast import CastShadow
from nlens_video.effects.shadow.casters import Casters, Moment
from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.scene.illumination import LUMINANCE, Illumination, Lamp, hemispheres, sun
from nlens_video.scene.patches import PosedPatches

FRAME = Box(0, 0, WIDTH, HEIGHT)
WALL = np.array([[0.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 0.5]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
GREY, RED, BLACK = (np.array(color) for color in ([0.5] * 3, [0.8, 0.1, 0.1], [0.0] * 3))


def disc(radius, height, rings=40):
    """Patches of a disc that looks down."""
    points, areas = [], []
    for ring in range(rings):
        middle = (ring + 0.5) / rings * radius
        for turn in np.linspace(0.0, 2.0 * math.pi, 60, endpoint=False):
            points.append([middle * math.cos(turn), height, middle * math.sin(turn)])
            areas.append(2.0 * math.pi * middle * radius / rings / 60)
    down = np.tile([0.0, -1.0, 0.0], (len(points), 1))
    return PosedPatches(np.array(points), down, np.array(areas), np.ones((len(points), 3)))


def wall(color):
    """Patches of both sides of `WALL`."""
    high, aside = (np.arange(12) + 0.5) / 12, (np.arange(12) + 0.5) / 12 - 0.5
    y, z = (one.ravel() for one in np.meshgrid(high, aside))
    points = np.column_stack([np.zeros(144), y, z])
    sides = np.repeat([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], 144, axis=0)
    twice = np.concatenate([points, points])
    return PosedPatches(twice, sides, np.full(288, 1 / 144), np.tile(color, (288, 1)))


def light(contact=1.0):
    """A sun from the right, 45 degrees high, and as much light from around."""
    around = np.full(3, 1.0 / math.pi)
    lamp = Lamp(sun(np.full(3, math.sqrt(2.0)), np.array([-1.0, -1.0, 0.0]) / math.sqrt(2.0)), 1e-6)
    return Illumination((lamp,), hemispheres(around, around), contact)


def loss(patches, given=None, **options):
    """The loss on the whole frame (h, w, 3)."""
    moment = Moment(Casters(WALL, FACES, edges_of(FACES)), looking_down())
    shadow = CastShadow(**options)([moment], given or light(), 0.0, None, patches)
    whole = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    inside = shadow.box.intersection(FRAME)
    whole[inside.slices_in(FRAME)] = shadow.loss[inside.slices_in(shadow.box)]
    return whole


@pytest.mark.parametrize(("radius", "height"), [(1.0, 1.0), (2.0, 0.5), (0.3, 1.5)])
def test_disc_above_the_ground_gives_the_light_of_its_form_factor(radius, height):
    patches = disc(radius, height)
    sent = np.broadcast_to([1.0, 2.0, 0.0], patches.points.shape)
    found = bounce(patches, sent, np.zeros((1, 1, 3)), np.full(3, 4.0), level_known=True)
    factor = radius**2 / (radius**2 + height**2)  # of a point below the middle of a disc
    np.testing.assert_allclose(found[0, 0], [factor / 4.0, factor / 2.0, 0.0], rtol=0.01)


def test_patch_is_lit_from_its_own_side_and_as_dark_as_its_shadow_below():
    patches = wall(GREY)
    none = np.zeros((288, 3))
    lit = sent_light(patches, light(), np.ones(3), 0.0, none)
    in_the_dark = sent_light(patches, light(), np.ones(3), 0.0, none + 1.0)
    right, left = slice(0, 144), slice(144, 288)
    np.testing.assert_allclose(lit[right] / lit[left], 2.0)  # sun and light around, or that alone
    np.testing.assert_allclose(in_the_dark[left], 0.0)
    np.testing.assert_allclose(in_the_dark[right], lit[left])


def test_patch_below_the_ground_sends_nothing():
    patches = wall(GREY)
    sent = sent_light(patches, light(), np.ones(3), 0.5, np.zeros((288, 3)))
    low = patches.points[:, 1] < 0.5
    assert not sent[low].any()
    assert (sent[~low] > 0.0).all()


def test_red_wall_leaves_a_redder_shadow_at_its_foot():
    plain, red = loss(None), loss(wall(RED))
    foot = np.s_[50:70, 74:79]  # 0.05 to 0.3 left of the wall, in its shadow
    assert np.allclose(plain[foot][..., 0], plain[foot][..., 2], atol=1e-6)
    gained = plain[foot] - red[foot]
    assert gained[..., 0].mean() > 5.0 * gained[..., 2].mean() > 0.0
    assert 0.01 < gained[..., 0].mean() < 0.4


def test_bounce_fades_with_the_distance_from_the_wall():
    gained = (loss(None) - loss(wall(GREY)))[60, :, 0]
    assert gained[78] > gained[72] > gained[64] > 0.0


def test_black_object_changes_nothing():
    assert np.array_equal(loss(wall(BLACK)), loss(None))


def test_ground_never_gets_more_light_than_the_plate_shows():
    bright = loss(wall(np.ones(3)), Illumination((*light().lamps,) * 3, light().ambient))
    assert bright.min() == 0.0
    assert bright.max() < 1.0


def test_bounce_only_tints_where_the_light_around_is_a_guess():
    plain, red = (loss(patches, light(contact=0.6)) for patches in (None, wall(RED)))
    foot = np.s_[50:70, 74:79]
    assert (red[foot][..., 2] - red[foot][..., 0]).mean() > 0.01
    np.testing.assert_allclose(red[foot] @ LUMINANCE, plain[foot] @ LUMINANCE, atol=1e-4)


def test_weaker_shadow_has_a_weaker_bounce():
    whole = loss(None) - loss(wall(RED))
    half = loss(None, strength=0.5) - loss(wall(RED), strength=0.5)
    foot = np.s_[50:70, 74:79]
    assert half[foot].mean() == pytest.approx(0.5 * whole[foot].mean(), rel=0.2)
