"""An object's place and light: what leaves its way is found, what moves by nature is not."""

import cv2
import numpy as np
import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.check.frames import frame_features
from nlens_video.check.motion import Look, Template
from nlens_video.core.settings import SourceSettings
from nlens_video.video.input.source import open_source

FRAMES = 24
LINE = [(88 + 3.0 * n, 88 + 1.5 * n) for n in range(FRAMES)]


@pytest.fixture
def checked(tmp_path):
    """Composite along some places onto a plate, and compare."""

    def run(places=LINE, *, pan=0.0, name="out.mkv", looks=lambda n: {}, plate=None, **options):
        codec = "ffv1" if name.endswith("mkv") else "libx264"
        shown = [takes.plate(n, pan=pan) if plate is None else plate(n) for n in range(len(places))]
        source = takes.encode(tmp_path / f"in_{name}", shown, codec=codec)
        pictures = [
            takes.with_object(picture, n, place=places[n], **looks(n))
            for n, picture in enumerate(takes.decode(source))
        ]
        result = takes.encode(tmp_path / name, pictures, codec=codec, **options)
        return compare(str(result), SourceSettings(spec=str(source))).verdict

    return run


def off(frames, by):
    """The line, but for some frames."""
    return [(x + by * (n in frames), y) for n, (x, y) in enumerate(LINE)]


def texts(verdict):
    return [one.text for one in verdict.findings]


@pytest.mark.parametrize(
    ("name", "options", "by"),
    [("out.mkv", {}, 1.2), ("out.mkv", {}, -5.0), ("out.mp4", {"crf": 18}, 3.0)],
)
def test_object_off_its_way_on_one_frame_is_reported(checked, name, options, by):
    (finding,) = checked(off({12}, by), name=name, **options).findings
    assert (finding.kind, finding.frame, finding.last) == ("pop", 12, 12)
    assert "off its way" in finding.text and finding.value == pytest.approx(by, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("pan", [0.0, 2.0])
def test_object_that_jitters_by_2_px_is_reported(checked, pan):
    verdict = checked(off(range(1, FRAMES, 2), 2.0), pan=pan)
    (finding,) = verdict.findings
    assert finding.kind == "flicker" and "to and fro" in finding.text
    assert finding.value == pytest.approx(1.0, abs=0.2)


@pytest.mark.slow
def test_object_without_texture_off_its_way_is_reported(checked):
    (finding,) = checked(off({12}, 3.0), looks=lambda n: {"detail": 0.0}).findings
    assert (finding.kind, finding.frame) == ("pop", 12)


def bouncing():
    """Free fall on a floor, thrown back with most of its speed."""
    y, speed, places = 45.0, 0.0, []
    for n in range(FRAMES):
        places.append((60 + 6.0 * n, y))
        y, speed = y + speed, speed + 2.2
        if y > 150.0:
            y, speed = 300.0 - y, -0.8 * speed
    return places


NATURAL = {
    "accelerating": [(50 + 0.4 * n * n, 90) for n in range(FRAMES)],
    "stopping at once": [(60 + 8.0 * min(n, 11), 90) for n in range(FRAMES)],
    "starting at once": [(60 + 8.0 * max(n - 12, 0), 90) for n in range(FRAMES)],
    "bouncing": bouncing(),
    "turning back": [(60 + 9.0 * abs(n - 12), 60 + 4.0 * n) for n in range(FRAMES)],
    "walking": [(60 + 5.0 * n, 90 + 6.0 * abs(np.sin(0.5 * n))) for n in range(FRAMES)],
    "entering": [(-36 + 7.0 * n, 90) for n in range(FRAMES)],
    "leaving": [(200 + 8.0 * n, 90 + 2.0 * n) for n in range(FRAMES)],
    "at rest": [(160, 90)] * FRAMES,
}


@pytest.mark.slow
@pytest.mark.parametrize("crf", [None, 18, 28, 32])
@pytest.mark.parametrize("motion", NATURAL)
def test_natural_motion_is_not_reported(checked, motion, crf):
    name, options = ("out.mkv", {}) if crf is None else ("out.mp4", {"crf": crf})
    assert texts(checked(NATURAL[motion], name=name, **options)) == []


def test_even_motion_at_uneven_times_is_not_reported(tmp_path):
    times = np.cumsum([0, *np.random.default_rng(7).choice([1, 1, 1, 2, 3], FRAMES - 1)]).tolist()
    source = takes.encode(tmp_path / "in.mkv", [takes.plate(0)] * FRAMES, codec="ffv1", times=times)
    pictures = [
        takes.with_object(plate, n, place=(60 + 4.0 * times[n], 96))
        for n, plate in enumerate(takes.decode(source))
    ]
    result = takes.encode(tmp_path / "out.mkv", pictures, codec="ffv1", times=times)
    assert texts(compare(str(result), SourceSettings(spec=str(source))).verdict) == []


@pytest.mark.slow
@pytest.mark.parametrize("crf", [None, 23])
def test_object_that_shakes_with_its_plate_is_not_reported(checked, crf):
    name, options = ("out.mkv", {}) if crf is None else ("out.mp4", {"crf": crf})
    shake = np.random.default_rng(5).normal(0.0, 2.0, FRAMES)
    places = [(x + by, y) for (x, y), by in zip(LINE, shake, strict=True)]
    verdict = checked(
        places, plate=lambda n: takes.plate(1, pan=20.0 - shake[n]), name=name, **options
    )
    assert texts(verdict) == []


@pytest.mark.slow
@pytest.mark.parametrize("pan", [0.0, 2.0])
def test_object_that_bounces_on_its_soft_shadow_keeps_place_and_light(tmp_path, pan):
    places = bouncing()
    source = takes.encode(
        tmp_path / "in.mkv", [takes.plate(n, pan=pan) for n in range(FRAMES)], codec="ffv1"
    )
    pictures = []
    for n, picture in enumerate(takes.decode(source)):
        shadow = np.zeros(picture.shape[:2], np.float32)
        cv2.ellipse(shadow, (round(places[n][0]) + 20, 166), (45, 14), 0, 0, 360, 1.0, -1)
        soft = cv2.GaussianBlur(shadow, (0, 0), 6)[..., None]
        pictures.append(takes.with_object(picture * (1 - 0.5 * soft), n, place=places[n]))
    result = takes.encode(tmp_path / "out.mp4", pictures, crf=18)
    said = texts(compare(str(result), SourceSettings(spec=str(source))).verdict)
    assert not [one for one in said if "off its way" in one or "light" in one]


@pytest.mark.parametrize("gain", [0.7, 0.75])
def test_single_frame_of_other_light_is_reported_once_by_its_size(checked, gain):
    verdict = checked(looks=lambda n: {"gains": (gain,) * 3 if n == 12 else (1, 1, 1)})
    (light,) = [one for one in verdict.findings if "light" in one.text]
    assert (light.kind, light.frame) == ("pop", 12) and "12: light of the object" in light.text
    size = 0.86 * np.log(gain)  # a gain of BT.709's code values, measured in sRGB's
    assert light.value == pytest.approx(size, abs=0.02)
    assert not [one for one in texts(verdict) if "stays so" in one]


def test_lasting_tint_is_reported(checked):
    verdict = checked(looks=lambda n: {"gains": (1, 1, 1.4 if n >= 12 else 1)})
    (finding,) = verdict.findings
    assert (finding.kind, finding.frame) == ("pop", 12) and "blue light" in finding.text


def test_lasting_change_of_light_is_named_as_one(checked):
    verdict = checked(looks=lambda n: {"gains": (0.6 if n >= 12 else 1,) * 3})
    light = [one for one in verdict.findings if "light" in one.text]
    assert [one.frame for one in light] == [12], texts(verdict)
    assert "12: light of the object changes at once by -" in light[0].text


def with_shadow_to_the_edge(number, gain):
    """A disc whose shadow on the ground leaves the frame below."""
    shadow = np.zeros((takes.HEIGHT, takes.WIDTH, 1), np.float32)
    shadow[100:, 80 + 3 * number : 140 + 3 * number] = 0.4
    plate = takes.plate(0) * (1 - cv2.GaussianBlur(shadow, (0, 0), 3)[..., None])
    return takes.with_object(plate, number, place=(88 + 3.0 * number, 80), gains=(gain,) * 3)


def test_light_is_judged_where_the_shadow_alone_reaches_the_frames_edge(tmp_path):
    source = takes.encode(tmp_path / "in.mkv", [takes.plate(0)] * FRAMES, codec="ffv1")
    pictures = [with_shadow_to_the_edge(n, 0.6 if n == 12 else 1.0) for n in range(FRAMES)]
    result = takes.encode(tmp_path / "out.mkv", pictures, codec="ffv1")
    verdict = compare(str(result), SourceSettings(spec=str(source))).verdict
    assert any("light of the object jumps" in one for one in texts(verdict)), texts(verdict)


def test_frames_whose_light_is_not_judged_are_noted(checked):
    verdict = checked([(-20 + 7.0 * n, 90) for n in range(FRAMES)])
    assert any("reaches the frame's edge on" in one for one in verdict.notes), verdict.notes


@pytest.mark.slow
def test_light_that_changes_with_the_plates_is_not_reported(checked):
    def dim(n):
        return 0.75 if n >= 12 else 1.0

    verdict = checked(
        plate=lambda n: dim(n) * takes.plate(0), looks=lambda n: {"gains": (dim(n),) * 3}
    )
    assert not [one for one in texts(verdict) if "light" in one]


@pytest.mark.parametrize("by", [2, -3])
def test_plate_altered_as_a_whole_is_reported(tmp_path, by):
    source = takes.encode(tmp_path / "in.mkv", [takes.plate(0)] * 6, codec="ffv1")
    pictures = [takes.with_object(one + by / 255, n) for n, one in enumerate(takes.decode(source))]
    result = takes.encode(tmp_path / "out.mkv", pictures, codec="ffv1")
    (finding,) = compare(str(result), SourceSettings(spec=str(source))).verdict.findings
    assert (finding.kind, finding.frame, finding.last) == ("plate", 0, 5)
    assert "the whole plate has" in finding.text
    assert finding.value == pytest.approx(by, abs=0.6)


def test_plate_of_another_tint_is_reported_with_its_frames(tmp_path):
    source = takes.encode(tmp_path / "in.mkv", [takes.plate(0)] * 6, codec="ffv1")
    blue = np.array([0.0, 0.0, 4 / 255], np.float32)
    pictures = [
        takes.with_object(one + blue * (n >= 3), n) for n, one in enumerate(takes.decode(source))
    ]
    result = takes.encode(tmp_path / "out.mkv", pictures, codec="ffv1")
    found = compare(str(result), SourceSettings(spec=str(source))).verdict.of("plate")
    assert [(one.frame, one.last) for one in found] == [(3, 5)] and "more blue" in found[0].text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("codec", "pixels", "options", "suffix"),
    [
        ("libx264", "yuv420p", {"crf": "18"}, "mp4"), ("libx264", "yuv420p", {"crf": "35"}, "mp4"),
        ("libx265", "yuv420p", {"crf": "28", "x265-params": "log-level=none"}, "mp4"),
        ("libvpx-vp9", "yuv420p", {"crf": "45", "b": "0", "cpu-used": "5"}, "webm"),
        ("mjpeg", "yuvj420p", {"qmin": "6", "qmax": "6"}, "avi"),
        ("prores_ks", "yuv422p10le", {}, "mov"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("light", [1.0, 0.12])
def test_encoding_alone_is_no_change_of_the_plate(tmp_path, codec, pixels, options, suffix, light):
    grain = np.random.default_rng(4).normal(0.0, 3 / 255, (FRAMES, takes.HEIGHT, takes.WIDTH, 1))
    shown = [light * takes.plate(n) + grain[n] for n in range(FRAMES)]
    source = takes.encode(tmp_path / "in.mkv", shown, codec="ffv1", audio=False)
    result = takes.coded_again(source, tmp_path / f"out.{suffix}", codec, pixels, options)
    assert compare(str(result), SourceSettings(spec=str(source))).verdict.of("plate") == []


@pytest.mark.parametrize("move", [(3.0, -2.0), (14.5, 6.0), (0.25, 0.0)])
def test_step_of_an_object_is_measured_to_a_fraction_of_a_pixel(tmp_path, move):
    places = [(120.0, 90.0), (120.0 + move[0], 90.0 + move[1])]
    plates = [takes.plate(0)] * 2
    shown = [takes.with_object(plates[0], n, place=place) for n, place in enumerate(places)]
    plate, result = (
        _features(takes.encode(tmp_path / name, pictures, codec="ffv1", audio=False))
        for name, pictures in (("in.mkv", plates), ("out.mkv", shown))
    )
    blocks = np.abs(result[0].colour - plate[0].colour).max(axis=2) > 3.0
    looks = [Look.of(*pair) for pair in zip(plate, result, strict=True)]
    step = Template.of(looks[0], blocks).step(looks[1])
    np.testing.assert_allclose(step, move, atol=0.2)


def _features(path):
    with open_source(str(path)) as source:
        return [frame_features(frame, 0, above_white=False) for frame in source]
