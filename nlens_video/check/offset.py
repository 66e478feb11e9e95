"""Which frame of the plate a result begins with, where nobody says it."""

from __future__ import annotations

from nlens_video import interrupts
from nlens_video.check.look import Look, look_at
from nlens_video.check.measure import clearer, misfit
from nlens_video.settings import SourceSettings
from nlens_video.video.opening import can_be_read_again
from nlens_video.video.source import Source, open_source

_ALIKE = 0.5  # a misfit so small ends the search: encoding alone makes as much [level]


def first_frame(result: str, plate: SourceSettings) -> int:
    """Index of the plate's frame that the result's first frame shows, 0 where none fits better.

    Only a result with fewer frames than its plate is looked at, for `--range` gives such; both are
    files that can be read again.

    Args:
        result: what `render` has written.
        plate: what it was made from; its range is not used.

    Raises:
        InputError: one of the two cannot be read.
    """
    if not (can_be_read_again(result) and can_be_read_again(plate.spec)):
        return 0
    with open_source(result) as made, open_source(plate.spec, **plate.hints) as given:
        if _as_long(made, given) or _size(made) != _size(given):
            return 0
        beginning = _first(made)
        if beginning is None:
            return 0
        return _best(beginning, given)


def _as_long(made: Source, given: Source) -> bool:
    counts = made.info.frame_count, given.info.frame_count
    return counts[0] is not None and counts[1] is not None and counts[0] >= counts[1]


def _size(source: Source) -> tuple[int, int]:
    return source.info.width, source.info.height


def _first(made: Source) -> Look | None:
    frame = next(iter(made), None)
    return None if frame is None else look_at(frame, frame.pts)


def _best(beginning: Look, given: Source) -> int:
    best, least, own = 0, 0.0, 0.0
    for frame in given:
        interrupts.look()
        off = misfit(beginning, look_at(frame, frame.pts))
        if frame.index == 0:
            own = least = off
        elif off < least and clearer(off, own):
            best, least = frame.index, off
        if least <= _ALIKE:
            break
    return best
