"""Elementary streams have no time stamps: their frames step by the rate that the codec states."""

from fractions import Fraction

import pytest
from support.clips import copy, noise_frame, read_times, write_clip

from nlens_video.video.input.source import open_source

FILM = Fraction(24000, 1001)
ENCODERS = {
    "h264": ("libx264", {"bf": "2"}),
    "hevc": ("libx265", {"x265-params": "log-level=none"}),
    "m2v": ("mpeg2video", {"bf": "2"}),
}


def elementary_stream(folder, ending, rate, count=12):
    codec, options = ENCODERS[ending]
    frames = [noise_frame(64, 48, "yuv420p", seed) for seed in range(count)]
    return write_clip(
        folder / f"in.{ending}", frames, codec=codec, options=options, rate=rate,
        pts=range(count), time_base=1 / rate, format_="mpeg2video" if ending == "m2v" else None,
    )  # fmt: skip


def steps(path):
    times = read_times(path)
    return [later - earlier for earlier, later in zip(times, times[1:], strict=False)]


@pytest.mark.parametrize(
    ("ending", "rate"),
    [("h264", Fraction(60)), ("h264", FILM), ("hevc", Fraction(30)), ("m2v", FILM)],
)
@pytest.mark.parametrize("target", ["out.mov", "out.avi"])
def test_frames_of_an_elementary_stream_step_by_its_own_rate(tmp_path, ending, rate, target):
    clip = elementary_stream(tmp_path, ending, rate)
    with open_source(str(clip)) as source:
        assert source.info.average_rate == rate
        assert source.info.steady
    copy(clip, tmp_path / target)
    found = steps(tmp_path / target)
    assert len(found) == 11
    assert {abs(step - 1 / rate) < Fraction(1, 50_000) for step in found} == {True}


def test_a_given_rate_overrides_that_of_an_elementary_stream(tmp_path):
    clip = elementary_stream(tmp_path, "h264", Fraction(60))
    with open_source(str(clip), input_rate="24") as source:
        assert source.info.average_rate == 24
        times = [frame.time_s for frame in source]
    assert times == pytest.approx([number / 24 for number in range(12)])
