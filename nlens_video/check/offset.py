"""Which frames of the plate a result shows, where nobody says it."""

from __future__ import annotations

import numpy as np

from nlens_video.check.frame_features import FrameFeatures, block_mean, frame_features
from nlens_video.core import signals
from nlens_video.core.settings import SourceSettings
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.input.source import open_source
from nlens_video.video.interfaces import Source

_MOST = 10.0  # what a block counts at most: the object is on the result alone [level]
_CLEARER = 0.97  # of the misfit of the plate's first frame: a still camera's frames differ little
_FAR_CLEARER = 0.6  # of that, a frame that no other is taken for
_BEYOND = 50  # frames after such a one in which none better ends the search


def find_range(result: str, plate: SourceSettings) -> tuple[int, int] | None:
    """The plate's frames that a shorter result begins in the midst of.

    Args:
        result: what `render` has written, for `--range` gives such.
        plate: what it was made from; its range is not used.

    Returns:
        First index and the one past the last; None where the result has as many frames as its
        plate or begins with it, or where one of the two cannot be read twice.

    Raises:
        InputError: one of the two cannot be read.
    """
    if not (can_be_read_again(result) and can_be_read_again(plate.spec)):
        return None
    with open_source(result) as made, open_source(plate.spec, **plate.hints) as given:
        if _as_long(made, given) or _size(made) != _size(given):
            return None
        frames = iter(made)
        frame = next(frames, None)
        first = 0 if frame is None else _best(frame_features(frame, frame.pts), given)
        return (first, first + 1 + sum(1 for _ in frames)) if first else None


def _as_long(made: Source, given: Source) -> bool:
    counts = made.info.frame_count, given.info.frame_count
    return counts[0] is not None and counts[1] is not None and counts[0] >= counts[1]


def _size(source: Source) -> tuple[int, int]:
    return source.info.width, source.info.height


def _best(beginning: FrameFeatures, given: Source) -> int:
    best, least, own = 0, 0.0, 0.0
    for frame in given:
        signals.check()
        off = _misfit(beginning, frame_features(frame, frame.pts))
        if frame.index == 0:
            own = least = off
        if off < least:
            best, least = frame.index, off
        if least < _FAR_CLEARER * own and frame.index >= best + _BEYOND:
            break
    return best if least < _CLEARER * own else 0


def _misfit(result: FrameFeatures, plate: FrameFeatures) -> float:
    """Mean difference of the blocks; a median would not see the little that moves [level]."""
    off = np.sqrt(block_mean(np.square(result.luma - plate.luma)))
    return float(np.minimum(off, _MOST).mean())
