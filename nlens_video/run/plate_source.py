"""The plate of a run: its source, opened for as long as it is read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import SourceSettings
from nlens_video.graph.scheduler import reader_blocked, run_in_thread
from nlens_video.video.info import SourceInfo
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.input.reconnect import Reconnecting
from nlens_video.video.input.seek import open_seekable
from nlens_video.video.input.source import open_source
from nlens_video.video.interfaces import Source


@contextmanager
def opened(given: SourceSettings, *, sparse: bool = False) -> Iterator[Source]:
    """The source, closed at the end unless its reader thread still blocks in a read.

    Args:
        given: the plate.
        sparse: as of `open_source`, where its first frame is wanted.

    Raises:
        InputError: the source cannot be read.
        UsageError: `--reconnect` is given for a source that cannot be opened again.
    """
    if given.reconnect_s and (given.spec == "-" or can_be_read_again(given.spec)):
        raise UsageError(
            f"--reconnect: {given.spec} ends for good; leave it out (it is for devices and URLs)"
        )

    seekable = given.frames[0] > 0 and can_be_read_again(given.spec)

    def connect(within_s: float | None = None) -> Source:
        if seekable:
            return open_seekable(given.spec, **given.hints)
        return open_source(given.spec, within_s, **given.hints, sparse=sparse)

    def reconnecting() -> Source:
        return Reconnecting(connect, given.reconnect_s) if given.reconnect_s else connect()

    source = run_in_thread(reconnecting)
    try:
        yield source
    finally:
        if not reader_blocked():
            source.__exit__(None, None, None)


def range_option(given: SourceSettings) -> str:
    """The option that chooses a plate's frames, for messages."""
    first, end = given.frames
    if given.one_frame:
        return f"--frame {first}"
    return f"--range {first}:{'' if end is None else end}"


def no_such_frames(given: SourceSettings, info: SourceInfo) -> str:
    """Message for a range without a frame, with those that there are.

    Args:
        given: the plate and the range.
        info: what is known of it; the count of a video is an estimate.
    """
    said = f"{range_option(given)} of the plate: no such frames"
    count = info.frame_count if info.kind in ("video", "sequence", "still") else None
    if not count or given.frames[0] < count:  # an estimate that was wrong helps nobody
        return said
    about = "about " if info.kind == "video" else ""
    whatever = ", whatever the numbers of the files" if info.kind == "sequence" else ""
    frames = "frame 0" if count == 1 else f"frames 0 to {count - 1}"
    return f"{said}; it has {about}{count}: {frames}, counted from 0{whatever}"


def frame_s(info: SourceInfo) -> float:
    """From one frame to the next, 0 for a still [s]."""
    if info.kind == "still" or not info.average_rate:
        return 0.0
    return float(1 / info.average_rate)


def length_s(info: SourceInfo) -> float | None:
    """How long a plate is, 0 for a still, None where it is not known [s]."""
    if info.kind == "stream":
        return None
    if info.kind == "still":
        return 0.0
    return info.duration_s or frame_s(info) * (info.frame_count or 0) or None
