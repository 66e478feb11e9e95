"""How dark the plate's own shadows are, and what is lit by it."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.courtyard import HEIGHT, LEFT, SEAT, TOWARD, UP, WIDTH, camera, courtyard, file_sun

from nlens_video.core.layers import Box
from nlens_video.core.settings import SUN_STRENGTH, SunSettings
from nlens_video.scene.illumination import sun
from nlens_video.scene.plate_environment import PLATE_COLUMNS
from nlens_video.scene.plate_shadows import share_in_shadow
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture


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


@pytest.mark.parametrize("scale", [1.0, 6.0])
def test_shadows_on_ground_beyond_white_are_measured_where_the_plate_is_light_itself(scale):
    seen = courtyard(camera(), TOWARD)
    light = np.float32(scale) * seen.linear(Box(0, 0, WIDTH, HEIGHT))
    found = share_in_shadow(ArrayPicture(light, "rgb", LINEAR), camera(), 0.0, TOWARD)
    assert np.log2(found) == pytest.approx(np.log2(LEFT), abs=0.06)


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


def test_given_sun_leaves_as_much_of_each_colour_as_the_plates_shadows_do():
    azimuth, elevation = azimuth_and_elevation()
    given = SceneLight(0, sun=SunSettings(azimuth_deg=azimuth, elevation_deg=elevation))
    found = lit(given, courtyard(camera(), TOWARD))
    assert np.log2(share_around(found)) == pytest.approx(np.log2(LEFT), abs=0.06)
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
