"""What travels along with a range of frames: the sound of its time, the subtitles on screen."""

from fractions import Fraction
from types import SimpleNamespace

import av
import pytest
from support import shots
from support.clips import copy_range
from support.programs import made

from nlens_video.run.frame_range import FrameRange
from nlens_video.video.exr import LINEAR
from nlens_video.video.info import CopiedStream, SourceFrame, SourceInfo
from nlens_video.video.input.seek import open_seekable
from nlens_video.video.input.source import open_source
from nlens_video.video.times.part import part_of

RATE = 25
STREAMS = ("video", "audio", "subtitle")


def packet(begin, end, kind="subtitle"):
    """A packet that is shown from one time to another [ms]."""
    return SimpleNamespace(
        pts=begin, dts=begin, duration=end - begin, time_base=Fraction(1, 1000),
        stream_index=STREAMS.index(kind),
    )  # fmt: skip


class Source:
    """Frames at 25 a second; its packets come before the first frame that does not begin earlier.

    Args:
        count: of the frames [1].
        packets: of its other streams, in the order of the file.
        ahead_s: by how much the file holds packets ahead of the frames [s].
    """

    def __init__(self, count, packets, ahead_s=0):
        copied = [SimpleNamespace(index=at, type=STREAMS[at]) for at in (1, 2)]
        self.info = SimpleNamespace(copied=copied, average_rate=RATE)
        self.count, self.packets, self.ahead_s = count, list(packets), ahead_s
        self.packet_sink = None

    def __iter__(self):
        for index in range(self.count):
            while self.packets and self.packets[0].pts <= 1000 * (index / RATE + self.ahead_s):
                self.packet_sink(self.packets.pop(0))
            yield SourceFrame(index=index, picture=None, pts=index, time_base=Fraction(1, RATE))


def carried(source, first, end):
    """Begin and end of each packet of a range, on the range's own clock [ms]."""
    items = FrameRange(source, (first, end)).items()
    return [(one.pts, one.pts + one.duration) for one in items if not isinstance(one, SourceFrame)]


@pytest.mark.parametrize("first", [50, 120])
def test_subtitle_on_screen_when_a_range_starts_is_shown_for_the_rest_of_its_time(first):
    said = [packet(0, 400), packet(500, 6000), packet(5500, 6500), packet(7000, 8000)]
    start = 1000 * first // RATE
    expected = [(0, 6000 - start), (5500 - start, 6500 - start), (7000 - start, 8000 - start)]
    assert carried(Source(250, said), first, 200) == expected


def test_subtitle_that_is_over_when_a_range_starts_is_left_out():
    said = [packet(500, 6000), packet(5500, 6500), packet(7000, 8000)]
    assert carried(Source(250, said), 150, None) == [(0, 500), (1000, 2000)]


def test_sound_that_begins_before_a_range_is_left_out_and_what_is_over_as_well():
    heard = [packet(at, at + 20, "audio") for at in range(0, 2000, 20)]
    assert carried(Source(50, heard), 25, 30)[0] == (0, 20)
    assert carried(Source(50, [packet(900, 1000)]), 25, 30) == []


@pytest.mark.parametrize("ahead_s", [0, 0.5, 1.5])
def test_sound_ends_with_the_last_picture_however_far_the_file_holds_it_ahead(ahead_s):
    heard = [packet(at, at + 21, "audio") for at in range(0, 4000, 21)]
    found = carried(Source(90, heard, ahead_s), 0, 4)
    assert [begin for begin, _ in found] == list(range(0, 160, 21))


def test_order_of_packets_is_kept_and_without_an_end_none_waits():
    heard = [packet(at, at + 21, "audio") for at in range(0, 1000, 21)]
    found = carried(Source(25, heard, 2), 0, None)
    assert [begin for begin, _ in found] == list(range(0, 1000, 21))


def test_sound_of_a_real_file_ends_with_the_last_picture(tmp_path):
    path = shots.write_video(tmp_path / "in.mp4", 40)
    with open_source(str(path)) as source:
        items = FrameRange(source, (0, 4)).items()
        begun = [one.pts * one.time_base for one in items if not isinstance(one, SourceFrame)]
    assert 0.1 < max(begun) < Fraction(4, 25)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_subtitle_on_screen_is_found_where_the_file_is_read_from_a_later_frame(tmp_path, suffix):
    (tmp_path / "said.srt").write_text("1\n00:00:00,100 --> 00:00:03,000\nfirst\n\n"
                                       "2\n00:00:07,000 --> 00:00:13,500\nlong\n")  # fmt: skip
    film = shots.write_video(tmp_path / "film.mkv", 400, group=12, audio=False)
    path = tmp_path / f"in.{suffix}"
    codec = "mov_text" if suffix == "mp4" else "srt"
    made("-i", film, "-i", tmp_path / "said.srt", "-c:v", "copy", "-c:s", codec, path)
    with open_seekable(str(path)) as source:
        (subtitles,) = [one.index for one in source.info.copied if one.type == "subtitle"]
        first = source._connection
        part = FrameRange(source, (330, 340))
        part.peek(8)
        part.skip_to = source.skip_to
        shown = [
            (one.pts * one.time_base, one.duration * one.time_base)
            for one in part.items()
            if not isinstance(one, SourceFrame) and one.stream_index == subtitles and one.size > 2
        ]
        assert source._connection is not first
    assert shown == [(0, pytest.approx(0.3, abs=0.002))]


def shown(path):
    """When each subtitle is shown, and when the pictures end [s]."""
    texts, last = [], 0.0
    with av.open(str(path)) as result:
        for one in result.demux():
            begin = float((one.pts or 0) * one.time_base)
            end = begin + float((one.duration or 0) * one.time_base)
            if one.stream.type == "subtitle" and one.size > 2:
                texts.append((begin, end))
            elif one.stream.type == "video":
                last = max(last, end)
    return texts, last


@pytest.mark.parametrize("first", [0, 20])
@pytest.mark.parametrize(("ending", "into"), [("mkv", "mkv"), ("mkv", "mp4"), ("mp4", "mp4")])
def test_subtitle_on_screen_at_a_range_end_ends_with_the_pictures(tmp_path, first, ending, into):
    (tmp_path / "said.srt").write_text("1\n00:00:00,900 --> 00:00:01,200\nshort\n\n"
                                       "2\n00:00:01,400 --> 00:00:09,000\nlong\n")  # fmt: skip
    film = shots.write_video(tmp_path / "film.mkv", 60, audio=False)
    codec = "mov_text" if ending == "mp4" else "srt"
    plate = made("-i", film, "-i", tmp_path / "said.srt", "-c:v", "copy", "-c:s", codec,
                 tmp_path / f"in.{ending}")  # fmt: skip
    out = tmp_path / f"out.{into}"
    copy_range(plate, out, first, 45)
    texts, last = shown(out)
    start, end = first / RATE, (45 - first) / RATE
    near = pytest.approx
    assert last == near(end, abs=0.002)
    assert texts == [
        (near(0.9 - start, abs=0.002), near(1.2 - start, abs=0.002)),
        (near(1.4 - start, abs=0.002), near(end, abs=0.002)),
    ]


def test_subtitle_of_a_range_without_an_end_lasts_as_long_as_it_did(tmp_path):
    (tmp_path / "said.srt").write_text("1\n00:00:01,400 --> 00:00:09,000\nlong\n")
    film = shots.write_video(tmp_path / "film.mkv", 60, audio=False)
    plate = made("-i", film, "-i", tmp_path / "said.srt", "-c:v", "copy", tmp_path / "in.mkv")
    copy_range(plate, tmp_path / "out.mkv", 25, None)
    texts, _ = shown(tmp_path / "out.mkv")
    assert texts == [(pytest.approx(0.4, abs=0.002), pytest.approx(8.0, abs=0.002))]


@pytest.mark.parametrize(
    ("first", "steady", "times", "ends"),
    [
        (10, True, None, Fraction(20, 25)), (0, True, None, None), (10, False, None, None),
        (10, False, {10: Fraction(1), 30: Fraction(4)}, 3),
        (0, False, {30: Fraction(4)}, 4), (10, True, {10: Fraction(1)}, Fraction(20, 25)),
    ],
)  # fmt: skip
def test_end_of_a_part_is_that_of_its_frames_or_unknown(first, steady, times, ends):
    info = SourceInfo(
        name="-", kind="stream", width=8, height=8, time_base=Fraction(1, 25),
        average_rate=Fraction(25), frame_count=None, duration_s=None, pixel_format="gray",
        tags=LINEAR, codec="ffv1", steady=steady, frame_time=times and times.get,
        copied=(CopiedStream(index=1, type="subtitle", codec="srt", stream=None),),
    )  # fmt: skip
    assert part_of(info, (first, 30)).ends_s == ends
    assert part_of(info, (first or 1, None)).ends_s is None
