"""Which of several videos of a file is the plate."""

from fractions import Fraction

import av
import pytest
from av.stream import Disposition
from support.clips import noise_frame

from nlens_video.core.errors import NoteKind, kind_of
from nlens_video.video.input.source import open_source

LARGE, SMALL = (64, 48), (48, 32)
NONE, DEFAULT = Disposition(0), Disposition.default


def file_of(path, *videos, cover=False):
    """A file of videos, each (size, disposition, quantiser), and of a cover of 256x256."""
    with av.open(str(path), "w") as out:
        streams = []
        for (width, height), disposition, quantiser in videos:
            stream = out.add_stream("libx264", 25, {"qp": str(quantiser)})
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.disposition = disposition
            streams.append(stream)
        if cover:
            stream = out.add_stream("png", 25)
            stream.width, stream.height, stream.pix_fmt = 256, 256, "rgb24"
            stream.disposition = Disposition.attached_pic
            streams.append(stream)
        for stream in streams:
            for index in range(12 if stream.name == "libx264" else 1):
                frame = noise_frame(stream.width, stream.height, stream.pix_fmt, seed=index)
                frame.pts, frame.time_base = index, Fraction(1, 25)
                out.mux(stream.encode(frame))
            out.mux(stream.encode(None))
    return path


def plate_of(path):
    """The size of the plate, and what is said of its choice."""
    with open_source(str(path)) as source:
        first = next(iter(source)).picture
        notes = [note for note in source.info.notes if "is the plate" in note]
        return (first.width, first.height), notes


@pytest.mark.parametrize("ending", ["ts", "mkv", "mp4"])
@pytest.mark.parametrize("place", [0, 1])
def test_largest_video_is_the_plate_and_is_named(tmp_path, ending, place):
    """FFmpeg's library takes the one of the highest bit rate."""
    videos = [(SMALL, DEFAULT, 1)]
    videos.insert(place, (LARGE, DEFAULT, 50))
    size, (note,) = plate_of(file_of(tmp_path / f"in.{ending}", *videos))
    assert size == LARGE
    assert note.startswith(f"stream {place} (64x48) is the plate")
    assert "2 videos" in note
    assert kind_of(note) is NoteKind.INFORMATION


def test_video_that_the_file_calls_its_default_is_the_plate(tmp_path):
    clip = file_of(tmp_path / "in.mkv", (LARGE, NONE, 1), (SMALL, DEFAULT, 50))
    size, (note,) = plate_of(clip)
    assert size == SMALL
    assert note.startswith("stream 1 (48x32) is the plate")


def test_cover_is_no_plate_however_large(tmp_path):
    clip = file_of(tmp_path / "in.mp4", (SMALL, DEFAULT, 30), cover=True)
    assert plate_of(clip) == (SMALL, [])
