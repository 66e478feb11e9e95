"""How dark the plate's own shadows are, and what is lit by it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nlens_video.core.settings import SUN_STRENGTH, SunSettings
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE, PosedLight, sun
from nlens_video.scene.plate_environment import PLATE_COLUMNS, Seat
from nlens_video.scene.plate_shadows import share_in_shadow
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 480, 270
SEAT = Seat(middle=np.array([0.0, 0.3, -3.5]), radius=0.4, ground_y=0.0)
UP = np.array([0.0, 1.0, 0.0])
TOWARD = np.array([0.8, 0.5, -0.3])  # to the sun, from the right and a little from behind
GROUND, THING = (0.30, 0.28, 0.25), (0.4, 0.06, 0.05)
LEFT = np.array([0.36, 0.40, 0.48])
PLACES = ((-1.2, -3.2), (-0.3, -2.6), (0.9, -2.9), (0.2, -4.2), (-1.5, -4.8), (1.4, -4.4))


def camera(pitch_deg=-30.0):
    """Two metres above the ground, turned down."""
    turn, pose = math.radians(pitch_deg), np.eye(4)
    pose[1:3, 1:3] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    pose[1, 3] = 2.0
    return Camera(
        world_from_camera=pose, fx=420.0, fy=420.0, cx=0.5 * WIDTH, cy=0.5 * HEIGHT,
        width=WIDTH, height=HEIGHT,
    )  # fmt: skip


def picture(light):
    """Linear light (h, w, 3) as a picture in sRGB, with a little grain."""
    light = light * np.random.default_rng(4).normal(1.0, 0.03, (HEIGHT, WIDTH, 1))
    light = np.clip(light, 0.0, 1.0)
    codes = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return ArrayPicture(np.round(255.0 * codes).astype(np.uint8), "rgb")


def ground(seen):
    """Points of the ground (h, w, 2), along X and Z."""
    return seen.plane_points(0.0)[..., [0, 2]]


def courtyard(seen, toward, *, things=True, tiles=0.0, left=LEFT, level=1.0):
    """Flat things on even ground, with the shadows that they cast away from a sun.

    Args:
        seen: camera.
        toward: to the sun.
        things: whether they are seen themselves; without them the shadows are stains.
        tiles: size of light and dark tiles, 0 for even ground [m].
        left: share of the light in the shadows.
        level: brightness of all.
    """
    places = ground(seen)
    away = -np.asarray(toward)[[0, 2]]
    length = float(np.hypot(*away))
    away, long = away / length, 0.7 / (toward[1] / length)
    light = np.broadcast_to(np.array(GROUND), (HEIGHT, WIDTH, 3)).copy()
    if tiles:
        odd = np.floor(places / tiles).astype(int).sum(axis=2) % 2 == 1
        light[odd] *= 0.45
    for place in PLACES:
        rel = places - place
        along, across = rel @ away, rel @ np.array([-away[1], away[0]])
        light[(along > 0.0) & (along < long) & (np.abs(across) < 0.2)] *= left
        if things:
            light[np.hypot(rel[..., 0], rel[..., 1]) < 0.25] = THING
    return picture(level * light)


def test_share_of_light_in_the_plates_shadows_is_measured_in_each_channel():
    found = share_in_shadow(courtyard(camera(), TOWARD), camera(), 0.0, TOWARD)
    assert np.log2(found) == pytest.approx(np.log2(LEFT), abs=0.06)


@pytest.mark.parametrize("turn_deg", [90.0, 180.0, 270.0])
def test_shadows_of_another_sun_tell_nothing(turn_deg):
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    x, y, z = TOWARD
    other = np.array([c * x + s * z, y, c * z - s * x])
    assert share_in_shadow(courtyard(camera(), TOWARD), camera(), 0.0, other) is None


def test_stains_are_no_shadows():
    stained = courtyard(camera(), TOWARD, things=False)
    assert share_in_shadow(stained, camera(), 0.0, TOWARD) is None


def test_patches_that_are_redder_than_the_ground_are_no_shadows_of_a_sun():
    red = courtyard(camera(), TOWARD, left=LEFT[::-1])
    assert share_in_shadow(red, camera(), 0.0, TOWARD) is None


def test_tiles_are_no_shadows():
    tiled = courtyard(camera(), TOWARD, left=np.ones(3), tiles=0.4)
    assert share_in_shadow(tiled, camera(), 0.0, TOWARD) is None


def test_ground_that_is_burnt_out_or_not_seen_tells_nothing():
    burnt = courtyard(camera(), TOWARD, level=5.0)
    assert share_in_shadow(burnt, camera(), 0.0, TOWARD) is None
    black = courtyard(camera(), TOWARD, level=0.0)
    assert share_in_shadow(black, camera(), 0.0, TOWARD) is None
    up = camera(pitch_deg=60.0)
    assert share_in_shadow(courtyard(camera(), TOWARD), up, 0.0, TOWARD) is None


def test_sun_from_straight_above_tells_nothing():
    assert share_in_shadow(courtyard(camera(), TOWARD), camera(), 0.0, UP) is None


def test_plates_of_a_few_pixels_are_measured_without_a_fault():
    small = ArrayPicture(np.full((2, 3, 3), 90, np.uint8), "rgb")
    view = replace(camera(), width=3, height=2, cx=1.5, cy=1.0, fx=3.0, fy=3.0)
    assert share_in_shadow(small, view, 0.0, TOWARD) is None


def lit(light, seen, lights=()):
    plate = seen.downsample(PLATE_COLUMNS, PLATE_COLUMNS * HEIGHT // WIDTH)
    around = light.around_without_sun(plate, camera(), SEAT, lights)
    return light.with_sun(around, seen, camera(), SEAT, lights)


def file_sun() -> PosedLight:
    return sun(np.array([2.0, 1.9, 1.7]), -TOWARD / np.linalg.norm(TOWARD))


def share_around(light):
    return light.irradiance_around(UP) / light.on_plane(SEAT.foot)


def test_shadow_of_the_files_sun_is_as_dark_as_the_plates_own_and_the_object_as_bright_as_before():
    scene, lamps = SceneLight(1), (file_sun(),)
    seen, even = courtyard(camera(), TOWARD), courtyard(camera(), TOWARD, left=np.ones(3))
    with_shadows, without = lit(scene, seen, lamps), lit(scene, even, lamps)
    assert without.shadow_left is None
    on_ground = scene.on_ground(lamps, with_shadows)
    assert np.log2(share_around(on_ground)) == pytest.approx(np.log2(LEFT), abs=0.06)
    untold = replace(with_shadows, shadow_left=None)
    one, other = (scene.on_object(lamps, each) for each in (with_shadows, untold))
    assert np.array_equal(one.ambient, other.ambient)


def test_two_suns_of_one_strength_are_not_measured_by_shadows_of_one():
    other = sun(np.array([2.0, 1.9, 1.7]), np.array([0.6, -0.8, 0.0]))
    lights = (file_sun(), other)
    assert lit(SceneLight(2), courtyard(camera(), TOWARD), lights).shadow_left is None


def azimuth_and_elevation():
    flat = math.hypot(TOWARD[0], TOWARD[2])
    return math.degrees(math.atan2(TOWARD[0], -TOWARD[2])), math.degrees(
        math.atan2(TOWARD[1], flat)
    )


def test_given_sun_is_as_strong_as_the_plates_shadows_say():
    azimuth, elevation = azimuth_and_elevation()
    given = SceneLight(0, sun=SunSettings(azimuth_deg=azimuth, elevation_deg=elevation))
    found = lit(given, courtyard(camera(), TOWARD))
    assert float(share_around(found) @ LUMINANCE) == pytest.approx(
        float(LEFT @ LUMINANCE), abs=0.02
    )
    on_ground = given.on_ground((), found)
    assert np.log2(share_around(on_ground)) == pytest.approx(np.log2(LEFT), abs=0.06)


def test_given_sun_is_usually_strong_where_the_plate_shows_no_shadows():
    azimuth, elevation = azimuth_and_elevation()
    given = SceneLight(0, sun=SunSettings(azimuth_deg=azimuth, elevation_deg=elevation))
    found = lit(given, courtyard(camera(), TOWARD, left=np.ones(3)))
    assert share_around(found) == pytest.approx(np.full(3, 1.0 / (1.0 + SUN_STRENGTH)))


def test_strength_that_is_given_overrides_the_plates_shadows():
    azimuth, elevation = azimuth_and_elevation()
    sun_ = SunSettings(azimuth_deg=azimuth, elevation_deg=elevation, strength=5.0)
    found = lit(SceneLight(0, sun=sun_), courtyard(camera(), TOWARD))
    assert found.shadow_left is None
    assert share_around(found) == pytest.approx(np.full(3, 1.0 / 6.0))
