"""A sun that the plate tells of: what the network's answer means, and what is lit by it."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from support import shots
from support.command import nlens
from support.courtyard import LEFT, SEAT, camera, courtyard, file_sun

from nlens_video.core.settings import NO_SUN, SunSettings
from nlens_video.networks.lazy import lazy_sun_reader
from nlens_video.scene.illumination import LUMINANCE, from_lamp
from nlens_video.scene.object_motion import turned_about_up
from nlens_video.scene.plate_sun import (
    ANSWERS,
    AZIMUTHS,
    CHANNELS,
    COLUMNS,
    ELEVATIONS,
    MAP_COLUMNS,
    MAP_ROWS,
    ROWS,
    PlateSun,
    ground_map,
    level_axes,
    plate_sun,
    read_sun,
    sun_features,
    toward_sun,
)
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.pixels.picture import ArrayPicture

PLATE = np.full((60, 90, 3), 0.3, np.float32)
PLATE[:, :20] = 0.1  # its left side is the dark one
COURT = courtyard(camera(), toward_sun(SunSettings(azimuth_deg=60.0, elevation_deg=35.0), camera()))


def answer(azimuth_deg, *, spread_deg=6.0, elevation_deg=40.0, shines=9.0, left_ev=-1.0):
    """What a network says that sees a sun there."""
    at = np.degrees(2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS)
    off = (at - azimuth_deg + 180.0) % 360.0 - 180.0
    heights = 5.0 + (np.arange(ELEVATIONS) + 0.5) * 80.0 / ELEVATIONS
    out = np.zeros(ANSWERS, np.float32)
    out[:AZIMUTHS] = -0.5 * (off / spread_deg) ** 2
    out[AZIMUTHS : AZIMUTHS + ELEVATIONS] = -0.5 * ((heights - elevation_deg) / 5.0) ** 2
    out[-2:] = shines, left_ev
    return out


def reader(azimuth_deg, **known):
    """A network that sees a sun on one side, and on the other in a mirror image."""

    def network(features):
        left, right = (features[-40:, half, :3].sum() for half in np.s_[:64, 64:])
        mirrored = left > right
        return answer(-azimuth_deg if mirrored else azimuth_deg, **known)

    return network


def reader_of_court(azimuth_deg, **known):
    """A network that sees a sun beyond the courtyard, and on the other side in its mirror image."""
    one = sun_features(COURT.downsample(COLUMNS, ROWS), ground_map(camera()))

    def network(features):
        mirrored = not np.array_equal(features[..., :3], one[..., :3])
        return answer(-azimuth_deg if mirrored else azimuth_deg, **known)

    return network


@given(st.floats(-180.0, 180.0), st.floats(12.0, 78.0))
def test_the_answer_tells_azimuth_and_elevation(azimuth, elevation):
    found = read_sun(reader(azimuth, elevation_deg=elevation), PLATE, camera())
    off = (math.degrees(found.azimuth) - azimuth + 180.0) % 360.0 - 180.0
    assert abs(off) < 3.0
    assert math.degrees(found.elevation) == pytest.approx(elevation, abs=2.0)
    assert found.certainty > 0.95


@pytest.mark.parametrize(
    "doubt", [{"shines": 0.0}, {"spread_deg": 60.0}], ids=["no sun", "no direction"]
)
def test_a_doubtful_sun_is_not_sure(doubt):
    assert read_sun(reader(50.0, **doubt), PLATE, camera()).certainty < 0.6
    assert not plate_sun(reader_of_court(60.0, **doubt), COURT, camera(), 0.0).sure


def test_a_plate_that_contradicts_its_mirror_image_is_not_sure():
    def stubborn(features):
        return answer(50.0)

    assert read_sun(stubborn, PLATE, camera()).certainty < 0.6


def test_a_sun_whose_shadows_the_ground_shows_is_believed_sooner():
    # as likely as 70 %: enough beside shadows that lie as it casts them, not without
    likely = {"shines": 0.85}
    seen = plate_sun(reader_of_court(60.0, **likely), COURT, camera(), 0.0)
    assert seen.sure
    np.testing.assert_allclose(np.log2(seen.left), np.log2(LEFT), atol=0.1)
    assert not plate_sun(reader_of_court(150.0, **likely), COURT, camera(), 0.0).sure
    assert plate_sun(reader_of_court(150.0, shines=4.0), COURT, camera(), 0.0).sure


@given(st.floats(-180.0, 180.0), st.floats(8.0, 60.0))
def test_turns_are_spread_about_the_azimuth_as_its_likelihood_is(azimuth, spread_deg):
    found = read_sun(reader(azimuth, spread_deg=spread_deg), PLATE, camera())
    turns = np.degrees(found.turns)
    assert (np.diff(turns) >= 0.0).all() and turns[-1] - turns[0] < 360.0
    off = math.degrees(found.azimuth) + turns.mean() - azimuth
    assert abs((off + 180.0) % 360.0 - 180.0) < 2.0
    assert turns.std() == pytest.approx(spread_deg, rel=0.12, abs=1.0)


def test_the_less_a_sun_is_likely_the_more_of_the_light_its_shadow_leaves():
    left = [
        float(read_sun(reader(50.0, shines=logit), PLATE, camera()).left[0])
        for logit in (-20.0, 0.0, 20.0)
    ]
    assert left == sorted(left, reverse=True)
    # without a sun every other place has a lamp
    assert 1.0 - left[0] == pytest.approx(0.5 * (1.0 - left[2]))


@given(st.floats(0.05, 20.0))
def test_features_do_not_depend_on_the_exposure(gain):
    plate = np.random.default_rng(1).uniform(0.05, 1.0, (56, 96, 3)).astype(np.float32)
    ground = ground_map(camera())
    one, other = (sun_features(light, ground) for light in (plate, np.float32(gain) * plate))
    assert one.shape == (MAP_ROWS, MAP_COLUMNS, CHANNELS)
    np.testing.assert_allclose(one, other, atol=1e-4)


def test_black_plates_have_features():
    features = sun_features(np.zeros((9, 9, 3), np.float32), ground_map(camera()))
    assert np.isfinite(features).all()


def test_a_camera_that_sees_no_ground_sees_no_sun():
    def never(features):
        raise AssertionError

    up = camera(pitch_deg=60.0)
    assert read_sun(never, PLATE, up) is None
    assert plate_sun(never, COURT, up, 0.0) is None


@given(st.floats(-60.0, -4.0), st.floats(-0.2, 0.2))
def test_the_map_shows_points_of_the_ground_where_the_camera_does(pitch_deg, roll):
    level = camera(pitch_deg=pitch_deg)
    lean = np.eye(4)
    lean[:2, :2] = [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
    seen = replace(level, world_from_camera=level.world_from_camera @ lean)
    ground = ground_map(seen)
    right, _, forward = level_axes(seen)
    eye = seen.world_from_camera[:3, 3]
    for row, column in ((90, 64), (60, 40), (20, 100)):
        away = eye[1] * math.exp(ground.distance[0, row, 0])
        around = float(ground.azimuth[0, 0, column])
        point = eye + away * (math.sin(around) * right + math.cos(around) * forward)
        point[1] = 0.0
        in_camera = seen.to_camera(point[None])
        place = ground.places[0, row, column] * (seen.width, seen.height)
        if in_camera[0, 2] < 0.0:
            np.testing.assert_allclose(place, seen.pixels(in_camera)[0], atol=0.05, rtol=1e-4)


def test_a_map_has_all_of_the_ground_that_the_frame_shows():
    ground = ground_map(camera(pitch_deg=-20.0))
    shown = ((ground.places[0] > 0.0) & (ground.places[0] < 1.0)).all(axis=-1)
    places = ground.places[0][shown]
    assert places[:, 0].min() < 0.02 and places[:, 0].max() > 0.98
    assert places[:, 1].max() > 0.98


@pytest.mark.parametrize("pitch_deg", [-50.0, -25.0, -12.0])
def test_a_direction_on_the_ground_is_the_same_on_the_map_at_any_pitch(pitch_deg):
    """A short way across the view and one along it are as long, by the map's own proportions."""
    ground = ground_map(camera(pitch_deg=pitch_deg))
    across = float(np.diff(ground.azimuth[0, 0, :2])[0])
    along = float(-np.diff(ground.distance[0, :2, 0])[0])
    assert along / across == pytest.approx(2.5, rel=1e-3)


def lit(light, seen=None, lights=()):
    """Light on the ground of a courtyard whose shadows fall away from a sun on the right."""
    plate = COURT.downsample(160, 90)
    around = light.around_without_sun(plate, camera(), SEAT, lights)
    return light.with_sun(around, COURT, camera(), SEAT, lights, seen)


SEEN = PlateSun(
    azimuth=math.radians(60.0), elevation=math.radians(35.0),
    turns=np.radians([-30.0, 0.0, 0.0, 30.0]), left=LEFT, certainty=0.9, sure=True,
)  # fmt: skip
UNSURE = replace(SEEN, certainty=0.4, sure=False)


def test_a_sun_on_the_plate_lights_what_no_file_lights():
    without, with_sun = lit(SceneLight(0)), lit(SceneLight(0), SEEN)
    (lamp,) = set(with_sun.lamps) - set(without.lamps)
    np.testing.assert_allclose(
        -lamp.posed.direction, toward_sun(SEEN.settings, camera()), atol=1e-6
    )
    levels = [light.on_plane(SEAT.foot) @ LUMINANCE for light in (without, with_sun)]
    assert levels[1] == pytest.approx(levels[0], rel=1e-3)


@pytest.mark.parametrize("seen", [SEEN, UNSURE], ids=["sure", "not sure"])
def test_its_shadow_is_as_dark_and_as_broad_as_was_read(seen):
    light = SceneLight(0)
    ground = light.on_ground((), lit(light, seen))
    lamp = ground.lamps[0]
    given = from_lamp(lamp, SEAT.foot)
    np.testing.assert_allclose(1.0 - given / ground.on_plane(SEAT.foot), LEFT, atol=1e-3)
    turned = turned_about_up(-lamp.posed.direction, lamp.turns)
    for direction, turn in zip(turned, seen.turns, strict=True):
        there = replace(seen, azimuth=seen.azimuth + turn).settings
        np.testing.assert_allclose(direction, toward_sun(there, camera()), atol=1e-6)


def test_a_sun_that_is_not_sure_lights_no_side_of_the_object():
    light = SceneLight(0)
    one, other = (light.on_object((), lit(light, seen)) for seen in (UNSURE, None))
    assert one.lamps == other.lamps
    np.testing.assert_array_equal(one.ambient, other.ambient)


@pytest.mark.parametrize(
    "light", [SceneLight(1), SceneLight(0, sun=NO_SUN)], ids=["the file's light", "--sun none"]
)
def test_what_is_told_is_not_read_off_the_plate(light):
    lights = (file_sun(),) if light.count else ()
    found, expected = lit(light, SEEN, lights), lit(light, None, lights)
    assert found.lamps == expected.lamps and found.on_ground is None


def test_no_sun_leaves_the_light_as_it_is():
    assert lit(SceneLight(0, sun=NO_SUN)).lamps == lit(SceneLight(0)).lamps
    assert "--sun none" in SceneLight(0, sun=NO_SUN).note
    assert SceneLight(0, sun=NO_SUN).toward_known_sun(camera(), ()) is None


def test_the_note_gives_the_sun_as_the_option_takes_it():
    assert "--sun 60,35 " in SEEN.note and "90 % sure" in SEEN.note
    assert "--sun 60,35 " in UNSURE.note and "no sun is sure" in UNSURE.note


@pytest.fixture(scope="module")
def shipped():
    return lazy_sun_reader()


def beneath(azimuth_deg, elevation_deg=35.0, **how):
    """A courtyard whose shadows fall away from a sun."""
    sun = SunSettings(azimuth_deg=azimuth_deg, elevation_deg=elevation_deg)
    return courtyard(camera(), toward_sun(sun, camera()), **how)


@pytest.mark.parametrize("azimuth", [-120.0, 0.0, 70.0, 150.0])
def test_shipped_network_reads_the_sun_off_the_shadows_of_things(shipped, azimuth):
    found = shipped(beneath(azimuth), camera(), 0.0)
    off = (math.degrees(found.azimuth) - azimuth + 180.0) % 360.0 - 180.0
    assert abs(off) < 20.0


@pytest.mark.parametrize(
    "codes",
    [
        np.zeros((5, 5, 3)),
        np.full((1, 1, 3), 255.0),
        np.full((64, 64, 3), 255.0) * (np.random.default_rng(2).random((64, 64, 1)) > 0.95),
        np.random.default_rng(3).uniform(0.0, 255.0, (112, 192, 3)),
        beneath(70.0, left=np.ones(3)).array,
    ],
    ids=["black", "a pixel", "burnt out", "noise", "things without shadows"],
)
def test_shipped_network_claims_no_sun_where_no_shadow_is(shipped, codes):
    plate = ArrayPicture(codes.astype(np.uint8), "rgb")
    height, width = codes.shape[:2]
    assert not shipped(plate, camera().resized(width, height), 0.0).sure


@pytest.mark.slow
@pytest.mark.needs_gl
def test_command_casts_the_shadow_of_a_sun_that_the_plate_tells(tmp_path):
    toward = toward_sun(SunSettings(azimuth_deg=-110.0, elevation_deg=35.0), shots.camera())
    shots.write_png(tmp_path / "in.png", courtyard(shots.camera(), toward).array)
    shots.cube_glb(tmp_path / "a.glb", start=(0.3, 0.0, -3.3), size=0.4, sun=False)
    shots.fit_json(tmp_path / "fit.json")

    def composited(name, *more):
        words = [tmp_path / "in.png", tmp_path / "a.glb", tmp_path / name, "-y", *more]
        run = nlens(*words, "--fit", tmp_path / "fit.json")
        assert run.returncode == 0
        told = "shadows on the plate tell a sun: --sun -1" in run.stdout + run.stderr
        return cv2.imread(str(tmp_path / name)).astype(int), told

    (shaded, told), (plain, silent) = composited("on.png"), composited("off.png", "--sun", "none")
    assert told and not silent
    view = shots.camera()
    away = -toward / np.hypot(toward[0], toward[2])
    for side, darker in ((0.6, True), (-0.6, False)):
        point = np.array([0.3, 0.0, -3.3]) + side * away * (1.0, 0.0, 1.0)
        column, row = np.round(view.pixels(view.to_camera(point[None]))[0]).astype(int)
        patch = np.s_[row - 2 : row + 3, column - 2 : column + 3]
        assert (shaded[patch].mean() < 0.85 * plain[patch].mean()) == darker
