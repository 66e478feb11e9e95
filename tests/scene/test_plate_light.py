"""Light around the object, estimated from the plate."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from nlens_video.core.settings import SunSettings
from nlens_video.scene.camera import Camera
from nlens_video.scene.environment import reduce_environment
from nlens_video.scene.illumination import (
    LUMINANCE,
    Illumination,
    Lamp,
    Light,
    PosedLight,
    hemispheres,
    on_ball,
    sun,
)
from nlens_video.scene.plate_environment import Seat, level_of_ground, plate_environment
from nlens_video.scene.scene_light import SceneLight
from nlens_video.scene.surround import mirrored_light, sphere
from nlens_video.video.pixels.picture import ArrayPicture

UP, DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])
AWAY, BACK = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
SEAT = Seat(middle=np.array([0.0, 0.5, -4.0]), radius=0.5, ground_y=0.0)
NO_LAMPS = Illumination((), None)
SKY, LAWN = (0.3, 0.35, 0.5), (0.06, 0.12, 0.03)


def level_camera(height=1.0):
    """A camera that looks along -Z, 53 degrees high: the horizon is in the middle."""
    pose = np.eye(4)
    pose[1, 3] = height
    return Camera(
        world_from_camera=pose, fx=100.0, fy=100.0, cx=80.0, cy=50.0, width=160, height=100
    )


def looking_down():
    """The same camera, turned down by 60 degrees: it sees no horizon."""
    camera = level_camera()
    turn = math.radians(-60.0)
    pose = camera.world_from_camera.copy()
    pose[1:3, 1:3] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    return replace(camera, world_from_camera=pose)


def plate(above=SKY, below=LAWN):
    """Two colours that meet at the horizon."""
    codes = np.empty((100, 160, 3), np.float32)
    codes[:50], codes[50:] = above, below
    return codes


def around(picture, **given):
    return SceneLight(0, **given).around_without_sun(picture, level_camera(), SEAT, ())


def test_surroundings_show_what_the_plate_shows_where_it_shows_it():
    radiance, _ = plate_environment(plate(), level_camera(), SEAT, NO_LAMPS)
    directions, _ = sphere(radiance.shape[1])
    for toward, color in (((0.0, 0.15, -1.0), SKY), ((0.0, -0.3, -1.0), LAWN)):
        unit = np.array(toward) / np.linalg.norm(toward)
        row, column = np.unravel_index(np.argmax(directions @ unit), directions.shape[:2])
        assert radiance[row, column] == pytest.approx(color, rel=0.05)


def test_ground_lights_the_underside_with_its_own_colour():
    light = around(plate())
    assert light.irradiance_around(DOWN) / math.pi == pytest.approx(LAWN, rel=0.15)


def test_light_from_above_has_half_the_tint_of_the_plate_and_not_the_grounds():
    up = around(plate((0.4, 0.3, 0.2), (0.2, 0.15, 0.1))).irradiance_around(UP)
    assert up[0] / up[2] == pytest.approx(math.sqrt(2.0), rel=0.05)


def test_grey_object_looks_grey_in_a_grey_plate():
    light = around(plate((0.5,) * 3, (0.18,) * 3))
    for normal in (UP, AWAY, BACK):
        red, green, blue = light.irradiance_around(normal)
        assert red == pytest.approx(green) == pytest.approx(blue)
    shown = 0.18 * light.irradiance_around(UP) / math.pi
    assert 0.12 < shown[0] < 0.35  # a grey card, as cameras expose it


def test_level_hardly_follows_what_a_plate_shows_but_follows_a_night():
    bright, dim, night = (
        around(plate((light,) * 3, (light,) * 3)).irradiance_around(UP)[1]
        for light in (0.3, 0.15, 0.01)
    )
    assert 1.0 < bright / dim < 1.2
    assert dim / night > 4.0


def test_the_more_is_burnt_out_below_the_horizon_the_more_light_falls_on_the_ground():
    levels = []
    for rows in (0, 2, 10, 30):
        picture = plate(below=(0.2, 0.2, 0.2))
        picture[100 - rows :, :40] = 1.0  # white things
        levels.append(level_of_ground(picture, level_camera(), SEAT))
    assert levels == sorted(levels)
    assert 1.3 < levels[2] / levels[0] < 4.0


@pytest.mark.parametrize("size", [2, 9])
def test_lamps_before_a_dark_background_tell_nothing_of_the_level(size):
    night = plate(above=(0.01, 0.01, 0.01), below=(0.02, 0.02, 0.02))
    night[80:] = 0.3  # the ground near the camera
    levels = []
    for brightness in (0.95, 1.0):
        picture = night.copy()
        for column in range(8, 150, 20):
            picture[60 : 60 + size, column : column + size] = brightness
        levels.append(level_of_ground(picture, level_camera(), SEAT))
    assert levels[1] == pytest.approx(levels[0], rel=0.01)


def test_a_burnt_out_sky_tells_nothing_of_the_light_on_the_ground():
    one, other = (
        level_of_ground(plate(above=(sky, sky, sky)), level_camera(), SEAT) for sky in (0.9, 1.0)
    )
    assert other == pytest.approx(one, rel=0.01)


def test_a_burnt_out_sky_below_a_wrong_horizon_tells_nothing_either():
    """The camera is taken to look down, and its horizon to be above the frame."""
    one, other = (
        level_of_ground(plate(above=(sky, sky, sky)), looking_down(), SEAT) for sky in (0.9, 1.0)
    )
    assert one <= other < 1.1 * one  # as the brighter picture by itself


def test_clipped_window_is_a_light_from_its_direction():
    picture = plate((0.1,) * 3, (0.1,) * 3)
    picture[10:22, 130:142] = 1.0
    light = around(picture)
    (lamp, *_) = sorted(light.lamps, key=lambda one: -one.posed.light.intensity)
    toward = -lamp.posed.direction
    expected = np.array([0.56, 0.34, -1.0]) / np.linalg.norm([0.56, 0.34, -1.0])
    assert toward @ expected > math.cos(math.radians(4.0))


@pytest.mark.parametrize("brightness", [5.0, 40.0])
def test_lamp_that_a_plate_of_light_shows_is_as_bright_as_it_is_told(brightness):
    room, lit = plate((0.1,) * 3, (0.1,) * 3), plate((0.1,) * 3, (0.1,) * 3)
    lit[10:22, 130:142] = brightness
    without, _ = plate_environment(room, level_camera(), SEAT, NO_LAMPS, math.inf)
    radiance, mirrored = plate_environment(lit, level_camera(), SEAT, NO_LAMPS, math.inf)
    assert radiance.max() == mirrored.max() == pytest.approx(brightness)
    up = reduce_environment(radiance, mirrored=mirrored).on_plane(SEAT.foot)
    dark = reduce_environment(without, mirrored=without).on_plane(SEAT.foot)
    assert up == pytest.approx(dark, rel=0.1)  # the level of the plate holds


def test_lamp_that_clips_beyond_white_is_raised_by_what_its_own_light_lacks():
    """HLG ends at 3.8 times white: a lamp there gives as much light as one that SDR clips."""
    given = []
    for peak in (1.0, 3.8):
        picture = plate((0.1,) * 3, (0.1,) * 3)
        picture[5:40, 115:155] = peak
        radiance, _ = plate_environment(picture, level_camera(), SEAT, NO_LAMPS, peak)
        given.append(radiance.max())
    assert peak < given[1] == pytest.approx(given[0], rel=0.1)


def test_lights_of_the_file_leave_less_for_the_light_around():
    lamp = sun(np.full(3, 2.0), DOWN)
    alone = around(plate())
    beside = SceneLight(1).around_without_sun(plate(), level_camera(), SEAT, (lamp,))
    up, rest = (float(one.irradiance_around(UP) @ LUMINANCE) for one in (alone, beside))
    assert 0.3 * up < rest < up
    assert len(SceneLight(1).on_object((lamp,), beside).lamps) == 1 + len(beside.lamps)


def beside(*lamps):
    """Luminous irradiance of the ground by light from around, beside lamps of the file."""
    light = SceneLight(len(lamps)).around_without_sun(plate(), level_camera(), SEAT, lamps)
    return float(light.irradiance_around(UP) @ LUMINANCE)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_distant_light_beside_the_strongest_is_part_of_the_light_around(share):
    key = sun(np.full(3, 2.0), DOWN)
    fill = sun(np.full(3, 2.0 * share / 0.8), np.array([0.6, -0.8, 0.0]))
    assert beside(key, fill) + 2.0 * share == pytest.approx(beside(key), rel=0.1)


def test_three_distant_lights_are_nearly_all_light():
    key = sun(np.full(3, 2.0), DOWN)
    fills = [sun(np.full(3, 0.2), np.array([x, -0.8, 0.0])) for x in (0.6, -0.6)]
    assert 0.0 < beside(key, *fills) < 0.3 * beside(key)


def test_shadow_of_the_strongest_sun_changes_without_a_jump_as_another_takes_its_place():
    rest = Illumination(
        (), hemispheres(np.full(3, 0.5), np.full(3, 0.3)), shadow_left=np.full(3, 0.45)
    )
    lost = []
    for strength in np.linspace(4.0, 0.2, 200):
        lamps = (sun(np.full(3, 1.0), np.array([0.6, -0.8, 0.0])), sun(np.full(3, strength), DOWN))
        light = SceneLight(2).on_ground(lamps, rest)
        lost.append(strength / light.on_plane(np.zeros(3))[0])
    assert lost[:10] == pytest.approx(10 * [0.55], abs=1e-6)
    assert np.abs(np.diff(lost)).max() < 0.02


def test_map_is_brought_to_the_level_of_the_plate_unless_its_exposure_is_given():
    environment = reduce_environment(np.full((16, 32, 3), 40.0, np.float32))
    assert around(plate(), environment=environment).level == pytest.approx(around(plate()).level)
    told = around(plate(), environment=environment, exposure_given=True)
    assert told.level == pytest.approx(environment.level)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "toward"),
    [
        (0.0, 30.0, (0.0, 0.5, -math.sqrt(0.75))),
        (90.0, 30.0, (math.sqrt(0.75), 0.5, 0.0)),
        (180.0, 30.0, (0.0, 0.5, math.sqrt(0.75))),
        (45.0, 90.0, (0.0, 1.0, 0.0)),
    ],
)
def test_sun_stands_to_the_right_of_the_view_and_takes_its_share(azimuth, elevation, toward):
    given = SunSettings(azimuth_deg=azimuth, elevation_deg=elevation, strength=3.0)
    without, seen = around(plate()), ArrayPicture(np.full((100, 160, 3), 90, np.uint8), "rgb")
    light = SceneLight(0, sun=given).with_sun(without, seen, level_camera(), SEAT, ())
    (lamp,) = light.lamps
    assert -lamp.posed.direction == pytest.approx(np.array(toward), abs=1e-6)
    assert light.on_plane(SEAT.foot) == pytest.approx(without.on_plane(SEAT.foot))
    rest = light.irradiance_around(UP)
    assert light.on_plane(SEAT.foot) == pytest.approx(4.0 * rest)


def test_camera_that_sees_no_ground_still_gives_a_light():
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # straight up
    pose[1, 3] = 1.0
    up = Camera(world_from_camera=pose, fx=100.0, fy=100.0, cx=80.0, cy=50.0, width=160, height=100)
    light = SceneLight(0).around_without_sun(plate(), up, SEAT, ())
    assert (light.irradiance_around(UP) > 0.0).all()
    assert np.isfinite(light.ambient).all()


def test_black_plate_gives_a_faint_light():
    light = around(np.zeros((10, 16, 3), np.float32))
    assert np.isfinite(light.ambient).all() and 0.0 < light.level < 0.1


def test_shadow_falls_by_lights_that_a_file_or_the_plate_tells():
    key = Illumination((Lamp(sun(np.ones(3), DOWN)),), hemispheres(np.ones(3), np.ones(3)))
    assert SceneLight(0).on_ground((), key).lamps
    assert SceneLight(0).on_object(()).lamps and not SceneLight(0).on_ground(()).lamps


def test_note_says_where_the_light_comes_from():
    assert "the plate's own light" in SceneLight(0).note
    both = SceneLight(2, reduce_environment(np.ones((16, 32, 3), np.float32))).note
    assert "2 lights" in both and "at the plate's level" in both
    given = SunSettings(azimuth_deg=60.0, elevation_deg=35.0)
    assert "--sun 60,35" in SceneLight(0, sun=given).note
    assert "--sun 60,35,3" in SceneLight(0, sun=replace(given, strength=3.0)).note


def test_a_sun_that_is_given_stands_in_for_the_files_suns_and_leaves_its_lamps():
    bulb = PosedLight(
        Light(kind="point", color=(1.0, 1.0, 1.0), intensity=5.0), np.array([0.0, 2.0, -4.0]), DOWN
    )
    lights = (sun(np.full(3, 4.0), DOWN), bulb)
    light = SceneLight(1, sun=SunSettings(azimuth_deg=60.0, elevation_deg=35.0, strength=2.0))
    beside = light.around_without_sun(plate(), level_camera(), SEAT, lights)
    alone = light.around_without_sun(plate(), level_camera(), SEAT, (bulb,))
    np.testing.assert_array_equal(beside.ambient, alone.ambient)
    codes = ArrayPicture(np.uint8(255 * plate()))
    with_sun = light.with_sun(beside, codes, level_camera(), SEAT, lights)
    shine = [lamp.posed for lamp in light.on_object(lights, with_sun).lamps]
    assert [one.light.kind for one in shine] == ["point", "directional"]
    assert shine[1].direction[1] == pytest.approx(-math.sin(math.radians(35.0)))


def test_contact_is_lighter_only_where_the_light_around_known_lamps_is_a_guess():
    lamps = (sun(np.ones(3), DOWN),)
    told = Illumination((), hemispheres(np.ones(3), np.ones(3)))
    plate_light = around(plate())
    assert SceneLight(1).on_ground(lamps, plate_light).contact < 1.0
    assert SceneLight(0).on_ground((), plate_light).contact == 1.0
    assert SceneLight(1, environment=told).on_ground(lamps, plate_light).contact == 1.0


@pytest.mark.parametrize("intensity", [1.0, 6.0, 2049.0, 100_000.0])
def test_files_lamps_in_lux_are_exposed_as_the_plate_is(intensity):
    lamp = sun(np.full(3, intensity), np.array([0.6, -0.8, 0.0]))
    beside = SceneLight(1).around_without_sun(
        plate((0.5,) * 3, (0.18,) * 3), level_camera(), SEAT, (lamp,)
    )
    lit = SceneLight(1).on_object((lamp,), beside)
    white = lit.on_plane(SEAT.foot) / math.pi
    assert 0.5 < white[1] < 2.5
    if intensity < 10.0:  # as other programs mean it: a matter of taste that is the file's
        assert lit.lamps[0].posed.light.intensity == pytest.approx(intensity)


def test_point_light_is_exposed_by_what_arrives_at_the_object():
    light = Light(kind="point", color=(1.0, 1.0, 1.0), intensity=1000.0)
    lamp = PosedLight(light, SEAT.middle + (0.0, 3.0, 0.0), DOWN)
    beside = SceneLight(1).around_without_sun(
        plate((0.5,) * 3, (0.18,) * 3), level_camera(), SEAT, (lamp,)
    )
    kept = SceneLight(1).on_object((lamp,), beside).lamps[0].posed.light.intensity
    assert 1.5 < kept / 3.0**2 < 4.0


@pytest.mark.parametrize(
    ("aside", "told"),
    [
        (Light(kind="spot", color=(1.0, 1.0, 1.0), intensity=1e4, outer_cone=0.3), False),
        (Light(kind="point", color=(1.0, 1.0, 1.0), intensity=1e4, range=0.5), False),
        (Light(kind="point", color=(1.0, 1.0, 1.0), intensity=1e4, range=9.0), True),
    ],
)
def test_light_that_does_not_reach_the_object_exposes_nothing(aside, told):
    key = sun(np.full(3, 2.0), DOWN)
    place = SEAT.middle + (2.0 * SEAT.radius + 1.0, 0.0, 0.0)
    other = PosedLight(aside, place, np.array([1.0, 0.0, 0.0]))
    assert (SceneLight(2).given((key, other), SEAT) > 2.001) == told


def test_part_of_an_object_in_the_cone_of_a_spot_is_reached():
    light = Light(kind="spot", color=(1.0, 1.0, 1.0), intensity=9.0, outer_cone=0.3)
    place = np.array([0.0, 3.0, 0.0])
    for aside, reached in ((0.0, True), (0.5, True), (1.5, True), (2.5, False)):
        lamp = Lamp(PosedLight(light, place + (aside, 0.0, 0.0), DOWN))
        assert (on_ball(lamp, np.zeros(3), 1.0) > 0.0) == reached


def test_ground_that_is_dark_before_a_bright_sky_lies_in_little_light():
    def white(ground):
        light = around(plate((0.4, 0.3, 0.25), (ground,) * 3))
        return float(light.on_plane(SEAT.foot)[1]) / math.pi

    assert white(0.02) == pytest.approx(0.02 / 0.06, rel=0.15)  # as if it were asphalt
    assert white(0.001) < white(0.02) < white(0.1) < white(0.3)
    assert white(0.001) > 0.04  # black ground is no night


def test_mirrors_show_the_sky_of_the_plate_and_less_of_the_sun_spread_over_it():
    radiance, mirrored = plate_environment(plate(), level_camera(), SEAT, NO_LAMPS)
    up = sphere(radiance.shape[1])[0][..., 1]
    guessed = (up > 0.0) & (radiance[..., 2] > 1.5 * SKY[2])
    assert guessed.mean() > 0.1  # the plate's sky does not give the light of its ground
    assert (mirrored[guessed] < 0.9 * radiance[guessed]).all()
    assert (mirrored[up > 0.0] > 0.9 * np.array(SKY)).all()
    light = around(plate())
    seen = mirrored_light(light.surround.levels, np.array([0.0, 0.3, -0.954]), 0.0)
    assert seen == pytest.approx(SKY, rel=0.05)


def test_camera_that_sees_no_sky_leaves_mirrors_the_light_that_is_guessed():
    _, mirrored = plate_environment(plate(LAWN, LAWN), looking_down(), SEAT, NO_LAMPS)
    assert mirrored[:8].mean() > 2.0 * np.mean(LAWN)


def test_colours_beyond_srgb_are_no_negative_light():
    deep = plate(above=(0.4, 0.3, -0.08), below=(-0.06, 0.2, 0.1))
    radiance, mirrored = plate_environment(deep, level_camera(), SEAT, NO_LAMPS)
    assert (radiance >= 0.0).all()
    assert (mirrored >= 0.0).all()


def test_sun_of_unbounded_brightness_in_view_leaves_the_level_as_a_clipped_one_does():
    clipped = plate()
    clipped[10:12, 20:22] = 1.0
    unbounded = clipped.copy()
    unbounded[10:12, 20:22] = 5e4
    levels = [level_of_ground(one, level_camera(), SEAT) for one in (clipped, unbounded)]
    assert levels[1] == pytest.approx(levels[0])
    ground = [around(one).irradiance_around(UP) @ LUMINANCE for one in (clipped, unbounded)]
    assert ground[1] == pytest.approx(ground[0], rel=0.1)
