"""Gaps between pictures in containers that store no times, so that sound stays in sync."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame

RATE = 48000
TICKS = 90000


def write_plate(path, moments, sound_s, *, time_base=Fraction(1, TICKS)):
    """Pictures at given times [s], numbered by their luma, and a ramp of quiet samples as sound."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("ffv1", 25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        video.time_base = video.codec_context.time_base = time_base
        sound = out.add_stream("pcm_s16le", RATE, layout="mono")
        for number, moment in enumerate(moments):
            frame = noise_frame(64, 48, "yuv420p", number)
            frame.planes[0].update(bytes([20 + 2 * number]) * frame.planes[0].buffer_size)
            frame.pts, frame.time_base = round(moment / time_base), time_base
            out.mux(video.encode(frame))
        samples = np.arange(round(sound_s * RATE)) % 30000 + 1
        for start in range(0, len(samples), 960):
            block = samples[None, start : start + 960].astype(np.int16)
            block = av.AudioFrame.from_ndarray(block, "s16", "mono")
            block.sample_rate, block.pts, block.time_base = RATE, start, Fraction(1, RATE)
            out.mux(sound.encode(block))
        out.mux([*video.encode(None), *sound.encode(None)])
    return path


def shown(path):
    """The number of the plate's picture on each picture of a file, by their luma."""
    with av.open(str(path)) as source:
        return [
            round(float(np.frombuffer(frame.planes[0], np.uint8)[: frame.width].mean()) / 2) - 10
            for frame in source.decode(video=0)
        ]


def heard(path):
    with av.open(str(path)) as source:
        return np.concatenate([frame.to_ndarray()[0] for frame in source.decode(audio=0)])


def gaps(notes):
    return [note for note in notes if "gaps between pictures" in note]


def with_gap(number, missing, count=100):
    """Times of a constant rate of 25 without some pictures, which repeat the one before."""
    left = [one for one in range(count) if not number <= one < number + missing]
    return [Fraction(one, 25) for one in left], [
        min(one, number - 1) if one < number + missing else one - missing for one in range(count)
    ]


@pytest.mark.parametrize("name", ["out.mxf", "out.y4m"])
@pytest.mark.parametrize("missing", [1, 30])
def test_lost_pictures_leave_the_one_before_for_their_time(tmp_path, name, missing):
    moments, expected = with_gap(20, missing)
    plate = write_plate(tmp_path / "in.mkv", moments, 4, time_base=Fraction(1, 1000))
    with av.open(str(plate)) as source:
        rate = source.streams.video[0].average_rate
    assert rate == 25
    notes = copy(plate, tmp_path / name)
    assert shown(tmp_path / name) == expected
    container = {"out.mxf": "mxf", "out.y4m": "yuv4mpegpipe"}[name]
    assert gaps(notes) == [
        f"gaps between pictures are filled with {missing}, each the one before again: {container} "
        "stores no times; .mov, .mkv and .mp4 files do"
    ]


def test_sound_of_mxf_is_whole_where_pictures_are_lost(tmp_path):
    plate = write_plate(tmp_path / "in.mkv", with_gap(20, 30)[0], 4, time_base=Fraction(1, 1000))
    copy(plate, tmp_path / "out.mxf")
    np.testing.assert_array_equal(heard(tmp_path / "out.mxf"), heard(plate))


@pytest.mark.parametrize("name", ["out.mxf", "out.y4m", "out.mov", "out.avi"])
def test_pictures_whose_times_are_rounded_are_not_repeated(tmp_path, name):
    moments = [Fraction(round(one * 1001 / 30), 1000) for one in range(60)]
    plate = write_plate(tmp_path / "in.mkv", moments, 2, time_base=Fraction(1, 1000))
    assert gaps(copy(plate, tmp_path / name)) == []
    assert shown(tmp_path / name) == list(range(60))


def test_pictures_that_come_faster_than_the_rate_are_said_to_be_late(tmp_path):
    moments = [Fraction(one, 50) for one in range(50)] + [
        Fraction(one, 25) for one in range(51, 90)
    ]
    plate = write_plate(tmp_path / "in.mkv", moments, 0.4, time_base=Fraction(1, 1000))
    (note,) = (one for one in copy(plate, tmp_path / "out.y4m") if "late" in one)
    assert note == (
        "pictures come up to 1.00 s late, at 25 per second: yuv4mpegpipe stores no times; .mov, "
        ".mkv and .mp4 files do"
    )


def test_a_wrong_time_of_hours_is_not_filled(tmp_path):
    moments = [Fraction(one, 25) + (0 if one < 10 else 5 * 3600) for one in range(20)]
    plate = write_plate(tmp_path / "in.mkv", moments, 0.4, time_base=Fraction(1, 1000))
    assert gaps(copy(plate, tmp_path / "out.y4m")) == []
    assert len(shown(tmp_path / "out.y4m")) == 20


@pytest.mark.parametrize(("sound_s", "lost"), [(4, "3.00"), (1.1, None)])
def test_sound_after_the_pictures_that_mxf_does_not_hold_is_told(tmp_path, sound_s, lost):
    plate = write_plate(tmp_path / "in.mkv", [Fraction(one, 25) for one in range(25)], sound_s)
    notes = [note for note in copy(plate, tmp_path / "out.mxf") if "(audio)" in note]
    assert notes == ([] if lost is None else [
        f"stream 1 (audio) loses its last {lost} s: mxf holds no sound after the pictures; "
        ".mov, .mkv and .mp4 files do"
    ])  # fmt: skip
