"""Pictures that damage has taken are counted, so that numbered results go to the right frames."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support import shots
from support.clips import noise_frame, write_clip

from nlens_video.video.input.source import open_source

TICK = Fraction(1, 25)
PACKET = 188
"""Bytes of a packet of MPEG-TS [1]."""


def write_broadcast(path, steps=range(60)):
    """Noise in MPEG-TS, at multiples of a frame."""
    frames = [noise_frame(64, 48, "yuv420p", index) for index in range(len(steps))]
    return write_clip(path, frames, codec="mpeg2video", pts=list(steps), time_base=TICK,
                      options={"bf": "2"})  # fmt: skip


def damaged(path, share=0.4, packets=60):
    """The file with zeros in place of some of its packets."""
    data = bytearray(path.read_bytes())
    first = int(len(data) * share) // PACKET * PACKET
    data[first : first + packets * PACKET] = bytes(packets * PACKET)
    path.write_bytes(data)
    return path


def read(path):
    """Number and time of each frame, as multiples of a frame, and the source when it has ended."""
    with open_source(str(path)) as source:
        frames = [(frame.number, round(frame.time_s / TICK)) for frame in source]
    return frames, source


def test_pictures_that_are_missing_in_mpeg_ts_are_counted(tmp_path):
    frames, source = read(damaged(write_broadcast(tmp_path / "in.ts")))
    assert source.damaged > 0
    assert len(frames) < 60
    shown = {step: number for number, step in reversed(frames)}  # one comes out of turn
    assert all(number == step for step, number in shown.items())
    assert frames[-1] == (59, 59)


def test_gaps_of_a_varying_rate_far_from_the_damage_are_no_lost_pictures(tmp_path):
    steps = [*range(30), *range(30, 180, 5), *range(180, 240), *range(260, 290)]
    frames, _ = read(damaged(write_broadcast(tmp_path / "in.ts", steps), share=0.1, packets=40))
    assert frames[-1][1] == 289
    assert frames[-1][0] == len(steps) - 1


def test_joined_recordings_are_not_damaged(tmp_path):
    part = write_broadcast(tmp_path / "part.ts")
    whole = tmp_path / "joined.ts"
    whole.write_bytes(part.read_bytes() * 2)
    frames, source = read(whole)
    assert source.damaged == 0
    assert [number for number, _ in frames] == list(range(120))


def write_jpeg(path, damage=None):
    """The plate as a JPEG: cut in the middle, with zeros in a tenth of it, or whole."""
    av.VideoFrame.from_ndarray(shots.plate(), "rgb24").save(str(path))
    data = bytearray(path.read_bytes())
    half, tenth = len(data) // 2, len(data) // 10
    if damage == "cut":
        del data[half:]
    elif damage == "zeros":
        data[half : half + tenth] = bytes(tenth)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(("damage", "count"), [("cut", 1), ("zeros", 1), (None, 0)])
def test_damaged_jpeg_is_read_as_far_as_it_goes_and_counted(tmp_path, damage, count):
    whole = write_jpeg(tmp_path / "whole.jpg")
    frames, source = read(write_jpeg(tmp_path / "in.jpg", damage=damage))
    assert (frames, source.damaged) == ([(0, 0)], count)
    above = [top_rows(path) for path in (whole, tmp_path / "in.jpg")]
    np.testing.assert_array_equal(*above)


def top_rows(path):
    with open_source(str(path)) as source:
        return next(iter(source)).picture.srgb()[:16]


def test_damaged_jpeg_of_a_sequence_is_counted_and_the_others_keep_their_places(tmp_path):
    for number in range(12):
        write_jpeg(tmp_path / f"p_{number}.jpg", "zeros" if number in (0, 7) else None)
    frames, source = read(tmp_path / "p_%d.jpg")
    assert [number for number, _ in frames] == list(range(12))
    assert source.damaged == 2
