"""Environment maps: extracted lights, remaining ambient light, and files that cannot be read."""

import math
import tracemalloc

import cv2
import numpy as np
import OpenEXR
import pytest

from nlens_video.core.color import chromaticities, primaries_from_bt709
from nlens_video.core.errors import InputError
from nlens_video.effects.planner import SHADOW, ShotFacts, decide
from nlens_video.scene.environment import load_environment, reduce_environment
from nlens_video.scene.plate_environment import sphere

TURNED = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+X 16 -Y 8\n" + bytes(4 * 128)


def even(level=0.5, width=128):
    return np.full((width // 2, width, 3), level, np.float32)


def with_sun(row=16, column=64):
    """Dim all round, and one texel with the light of a sun: 45 degrees up, towards +X."""
    sky = even(0.01)
    sky[row, column] = 5000.0
    return sky


def irradiance_of(sky, normal):
    """Brute force: every texel's radiance by its cosine and solid angle."""
    height, width = sky.shape[:2]
    up = math.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    turn = 2 * math.pi * ((np.arange(width) + 0.5) / width - 0.5)[None]
    x, z = np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn)
    toward = np.stack([x, np.broadcast_to(np.sin(up), x.shape), z], axis=-1)
    cosine = np.maximum(toward @ normal, 0.0) * np.cos(up) * (math.pi / height) ** 2
    return (sky * cosine[..., None]).sum((0, 1))


def test_bright_texel_becomes_a_light_from_its_direction():
    light = reduce_environment(with_sun())
    (lamp,) = light.lamps
    expected = np.array([-1.0, -1.0, 0.0]) / math.sqrt(2.0)
    assert lamp.posed.direction == pytest.approx(expected, abs=0.04)
    assert lamp.diameter < 0.05
    assert lamp.posed.light.intensity == pytest.approx(
        5000.0 * math.cos(math.pi / 4) * (math.pi / 64) ** 2, rel=0.03
    )


def test_environment_rotation_is_counter_clockwise_from_above():
    (lamp,) = reduce_environment(with_sun(), rotation_deg=90.0).lamps
    expected = np.array([0.0, -1.0, 1.0]) / math.sqrt(2.0)  # it stands over -Z now
    assert lamp.posed.direction == pytest.approx(expected, abs=0.04)


def test_environment_exposure_is_in_stops():
    one, eight = (reduce_environment(with_sun(), exposure_ev=ev) for ev in (0.0, 3.0))
    assert eight.ambient == pytest.approx(8.0 * one.ambient)
    assert eight.lamps[0].posed.light.intensity == pytest.approx(
        8.0 * one.lamps[0].posed.light.intensity
    )


def test_uniform_environment_has_ambient_light_only():
    light = reduce_environment(even(0.5))
    assert light.lamps == ()
    for normal in np.vstack([np.eye(3), -np.eye(3)]):
        assert light.irradiance_around(normal) == pytest.approx(np.full(3, 0.5 * math.pi), rel=1e-3)


def test_lights_and_ambient_light_add_up_to_the_environment():
    rng = np.random.default_rng(3)
    sky = cv2.GaussianBlur(rng.random((64, 128, 3)).astype(np.float32) ** 4, (0, 0), 4)
    sky[10:16, 20:30] += 8.0
    light = reduce_environment(sky)
    assert 1 <= len(light.lamps) <= 6
    for normal in np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]):
        total = light.irradiance_around(normal)
        for lamp in light.lamps:
            posed = lamp.posed
            facing = max(0.0, -float(posed.direction @ normal))
            total = total + np.array(posed.light.color) * posed.light.intensity * facing
        assert total == pytest.approx(irradiance_of(sky, normal), rel=0.06)


@pytest.mark.parametrize("radius_deg", [0.26, 1.0, 3.0])
@pytest.mark.parametrize("columns", [1024, 2048])
def test_light_straight_above_is_counted_once(columns, radius_deg):
    height = columns // 2
    edges = np.cos(math.pi * np.arange(height + 1) / height)
    inside = math.pi * (np.arange(height) + 0.5) / height < math.radians(max(radius_deg, 0.2))
    covered = 2.0 * math.pi * float((edges[:-1] - edges[1:])[inside].sum())
    sky = even(0.01, columns)
    sky[inside] += 4.0 / covered
    given = sum(lamp.posed.light.intensity for lamp in reduce_environment(sky).lamps)
    assert given == pytest.approx(4.0, rel=0.02)


def test_smooth_surfaces_mirror_wide_lights_and_not_the_sun():
    sky = even(0.02, 512)
    sky[100:140, 300:356] = 8.0  # a softbox of 28 by 39 degrees
    sky[40, 40] = 30000.0
    light = reduce_environment(sky)
    wide = [lamp for lamp in light.lamps if lamp.posed.in_surround]
    assert wide and len(wide) == len(light.lamps) - 1
    np.testing.assert_allclose(light.surround.radiance[101:139, 301:355], 8.0, rtol=1e-5)
    assert light.surround.radiance[40, 40].max() < 8.0


@pytest.mark.parametrize(("spread_deg", "mirrored"), [(1.5, False), (2.5, False), (5.0, True)])
@pytest.mark.parametrize("azimuth_deg", [20.0, 178.0])
def test_parts_of_one_light_are_all_mirrored_or_none(spread_deg, mirrored, azimuth_deg):
    turn = math.radians(azimuth_deg)
    toward = 0.8 * np.array([math.cos(turn), 0.75, math.sin(turn)])
    cosine = np.clip(sphere(512)[0] @ toward, -1.0, 1.0)
    glow = 200.0 * np.exp(-0.5 * (np.degrees(np.arccos(cosine)) / spread_deg) ** 2)
    light = reduce_environment((0.05 + glow[..., None] * np.ones(3)).astype(np.float32))
    assert len(light.lamps) > 1
    assert {lamp.posed.in_surround for lamp in light.lamps} == {mirrored}


def test_light_of_a_plate_keeps_its_highlights():
    sky = even(0.02, 512)
    sky[100:140, 300:356] = 8.0
    light = reduce_environment(sky, mirrored=sky)
    assert light.lamps and not any(lamp.posed.in_surround for lamp in light.lamps)


def written_exr(path, channels, **header):
    with OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels) as made:
        made.write(str(path))
    return path


def rgb_channels(light):
    return {name: np.ascontiguousarray(light[..., i]) for i, name in enumerate("RGB")}


@pytest.mark.parametrize("primaries", ["bt709", "bt2020", "ap1", "ap0"])
def test_primaries_of_a_map_are_read_from_its_file(tmp_path, primaries):
    light = np.broadcast_to(np.float32([0.5, 0.25, 0.1]), (32, 64, 3))
    own = (light @ primaries_from_bt709(primaries).T).astype(np.float32)
    given = tuple(float(value) for value in chromaticities(primaries))
    path = written_exr(tmp_path / "a.exr", rgb_channels(own), chromaticities=given)
    found = load_environment(path, 0.0, 0.0)
    assert found.ambient[0] == pytest.approx([0.5, 0.25, 0.1], rel=1e-3)


def test_map_of_one_channel_is_grey(tmp_path):
    path = written_exr(tmp_path / "a.exr", {"Y": np.full((32, 64), 0.5, np.float32)})
    assert load_environment(path, 0.0, 0.0).ambient[0] == pytest.approx(np.full(3, 0.5), rel=1e-3)


def test_cropped_map_is_black_beyond_its_data_window(tmp_path):
    upper = np.full((16, 64, 3), 0.5, np.float32)
    window = (np.array([0, 0], np.int32), np.array([63, 31], np.int32))
    path = written_exr(tmp_path / "a.exr", rgb_channels(upper), displayWindow=window)
    light = load_environment(path, 0.0, 0.0)
    assert light.irradiance_around(np.array([0.0, 1.0, 0.0])) / math.pi == pytest.approx(
        np.full(3, 0.5), rel=0.05
    )
    assert light.irradiance_around(np.array([0.0, -1.0, 0.0])).max() < 0.1


def test_black_environment_gives_no_light():
    light = reduce_environment(even(0.0))
    assert light.lamps == () and not light.ambient.any()


def test_large_map_is_reduced_where_it_lies(tmp_path):
    sky = np.full((2048, 4096, 3), 0.5, np.float32)
    cv2.imwrite(str(tmp_path / "sky.hdr"), sky)
    tracemalloc.start()
    try:
        light = load_environment(tmp_path / "sky.hdr", 0.0, 0.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.5 * sky.nbytes
    assert light.ambient[0] == pytest.approx(0.5, rel=1e-3)


def test_hdr_file_is_read_as_it_was_written(tmp_path):
    sky = with_sun()
    cv2.imwrite(str(tmp_path / "sky.hdr"), sky)
    light = load_environment(tmp_path / "sky.hdr", 0.0, 0.0)
    assert light.lamps[0].posed.direction == pytest.approx(
        reduce_environment(sky).lamps[0].posed.direction, abs=1e-3
    )


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("none.hdr", lambda path: None, "no such file"),
        ("text.hdr", lambda path: path.write_text("no map"), "cannot be read"),
        ("empty.hdr", lambda path: path.write_bytes(b""), "cannot be read"),
        ("text.exr", lambda path: path.write_text("no map"), "cannot be read"),
        ("turned.hdr", lambda path: path.write_bytes(TURNED), "rows from the top"),
        ("wide.hdr", lambda path: cv2.imwrite(str(path), even()[:10]), "twice as wide"),
    ],
)
def test_invalid_environment_map_is_refused_in_one_line(tmp_path, capfd, name, write, words):
    write(tmp_path / name)
    with pytest.raises(InputError, match=words) as caught:
        load_environment(tmp_path / name, 0.0, 0.0)
    assert capfd.readouterr().err == ""
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("scene", "wanted", "words"),
    [
        (ShotFacts(lamps=2), True, "2 lights"),
        (ShotFacts(lamps=0), True, "ambient light"),
        (ShotFacts(lamps=1, pre_rendered=True), False, "layers"),
        (ShotFacts(lamps=1, pre_rendered=True, sun=True), True, "1 light"),
        (ShotFacts(lamps=1, strength=0.0), False, "--shadow-strength 0"),
    ],
)
def test_automatic_shadow_falls_in_any_light_but_that_of_layers(scene, wanted, words):
    (decision,) = (one for one in decide("auto", scene) if one.effect == SHADOW)
    assert decision.wanted is wanted and words in decision.reason


def test_shadow_can_be_requested_and_disabled():
    layers = ShotFacts(lamps=1, pre_rendered=True)
    for asked, wanted in (("defocus,shadow", True), ("defocus", False), ("none", False)):
        assert [d.wanted for d in decide(asked, layers) if d.effect == SHADOW] == [wanted]
