"""Results last as long as the plate, whatever durations its packets state."""

from fractions import Fraction

import av
import pytest
from support.clips import copy, noise_frame, write_clip

from nlens_video.video.input.source import open_source

STEP, GAP, COUNT = 640, 48000, 24  # ticks of 1/16000 s


def plate_with_a_gap(folder, at):
    """H.264 with reordered pictures, of which one stands still for 3 s.

    In MP4 a packet lasts until the next one is decoded: another picture's packet states the gap.
    """
    frames = [noise_frame(64, 48, "yuv420p", seed) for seed in range(COUNT)]
    pts = [index * STEP + (GAP if index >= at else 0) for index in range(COUNT)]
    options = {"bf": "2", "b-adapt": "0", "preset": "veryfast"}
    return write_clip(folder / "in.mp4", frames, codec="libx264", pts=pts, options=options)


def length_s(path):
    with av.open(str(path)) as container:
        return Fraction(container.duration, av.time_base)


@pytest.mark.parametrize("at", [10, 16, 21, 22, 23])
def test_a_gap_between_reordered_pictures_makes_no_result_longer(tmp_path, at):
    plate = plate_with_a_gap(tmp_path, at)
    end_s = Fraction(GAP + COUNT * STEP, 16000)
    for name, codec in (("out.mp4", "libx264"), ("out.mkv", "libx264"), ("ffv1.mkv", "ffv1")):
        copy(plate, tmp_path / name, codec=codec)
        assert length_s(tmp_path / name) <= end_s, name
        assert length_s(tmp_path / name) == end_s or name == "out.mp4"


def test_a_frame_lasts_until_the_next_one_or_the_end(tmp_path):
    with open_source(str(plate_with_a_gap(tmp_path, 10))) as source:
        frames = list(source)
    ends = [frame.pts + frame.duration for frame in frames]
    nexts = [frame.pts for frame in frames[1:]] + [GAP + COUNT * STEP]
    assert all(end <= following for end, following in zip(ends, nexts, strict=True))
    assert ends[-1] == nexts[-1]
