"""What a range of a source takes over: its timecode goes on, its chapters are cut."""

from fractions import Fraction

import pytest
from msgspec.structs import replace
from support.clips import noise_frame, write_clip

from nlens_video.video.input.seek import open_seekable
from nlens_video.video.input.source import open_source
from nlens_video.video.times.part import advanced_timecode, part_of

NTSC = Fraction(30000, 1001)


@pytest.mark.parametrize(
    ("timecode", "frames", "rate", "later"),
    [
        ("01:02:03:04", 25, Fraction(25), "01:02:04:04"),
        ("23:59:59:24", 1, Fraction(25), "00:00:00:00"),
        ("00:00:59;29", 1, NTSC, "00:01:00;02"),
        ("00:09:59;29", 1, NTSC, "00:10:00;00"),
        ("00:00:00;00", 17982, NTSC, "00:10:00;00"),
        ("00:00:00:00", 1800, NTSC, "00:01:00:00"),
        ("00:00:59;59", 1, 2 * NTSC, "00:01:00;04"),
        ("no timecode", 5, Fraction(25), "no timecode"),
    ],
)
def test_timecode_of_a_range_starts_at_its_first_frame(timecode, frames, rate, later):
    assert advanced_timecode(timecode, frames, rate) == later


def chapter(start, end, title):
    """One in milliseconds."""
    unit = Fraction(1, 1000)
    return {"id": 1, "start": start, "end": end, "time_base": unit, "metadata": {"title": title}}


def test_range_keeps_its_chapters_and_timecode(tmp_path):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p") for _ in range(3)])
    chapters = (chapter(0, 400, "a"), chapter(400, 1600, "b"), chapter(1600, 9000, "c"))
    with open_source(str(clip)) as source:
        whole = replace(source.info, chapters=chapters, stream_metadata={"TIMECODE": "00:00:10:00"})
    part = part_of(whole, (25, 50))
    assert [(one["start"], one["end"]) for one in part.chapters] == [(0, 600), (600, 1000)]
    assert part.stream_metadata == {"TIMECODE": "00:00:11:00"}
    assert part_of(whole, (0, None)) is whole


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_range_of_a_varying_rate_begins_at_the_time_of_its_first_frame(tmp_path, ending):
    """Frames of 40 ms, then of 400 ms: their average is nobody's."""
    pts = [*range(0, 1000, 40), *range(1000, 5000, 400)]
    clip = write_clip(
        tmp_path / f"in.{ending}", [noise_frame(64, 48, "yuv420p", s) for s in range(len(pts))],
        codec="libx264", pts=pts, time_base=Fraction(1, 1000),
    )  # fmt: skip
    chapters = (chapter(0, 1400, "a"), chapter(1400, 5000, "b"))
    with open_seekable(str(clip)) as source:
        whole = replace(source.info, chapters=chapters, stream_metadata={"timecode": "00:00:10:00"},
                        average_rate=Fraction(10))  # fmt: skip
        part = part_of(whole, (20, 30))
    cut = [(one["start"], one["end"], one["metadata"]["title"]) for one in part.chapters]
    assert cut == [(0, 600, "a"), (600, 2200, "b")]
    assert part.stream_metadata == {"timecode": "00:00:10:08"}
