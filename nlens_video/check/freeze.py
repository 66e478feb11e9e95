"""Frames on which an object stands still between others on which it moves."""

from __future__ import annotations

import numpy as np

from nlens_video.check.regions import Track, beside
from nlens_video.check.series import freezes
from nlens_video.check.verdict import Finding, at
from nlens_video.core.layers import Float64

_STILL = 0.75  # largest change of a still block of the result from frame to frame [level]
_SHORT = 5  # frames; a longer stop is meant, unless the object then is where it would have been
_CAUGHT_UP = 0.5  # share of the missed way [1]
_RESTS = 0.25  # share of the plate's motion around that it has where the camera pauses [1]
_WITH_PLATE = 0.5  # share of the plate's motion by which what stands on the ground is off it [1]


def judge_freezes(track: Track) -> list[Finding]:
    """Freezes of one object, but for frames on which something passes it."""
    span = np.arange(track.frames[0], track.frames[-1] + 1)
    here = np.array(track.frames, np.int64) - span[0]
    motion, way = np.full(len(span), np.nan), np.full((len(span), 4), np.nan)
    motion[here] = track.motion
    way[here, :2] = np.array(track.steps).reshape(len(here), -1)[:, :2]
    way[here, 2:] = np.array(track.plate_steps).reshape(len(here), 2)
    motion[:1] = 0.0  # no step leads to the first frame
    return [
        at(
            "freeze", (int(span[first]), int(span[last])), float(motion[first]),
            "the object stands still, and moves before and after",
        )
        for first, last in freezes(motion, _STILL)
        if not beside(track.disturbed, int(span[first]), int(span[last]))
        and (last - first < _SHORT or _catches_up(way[:, :2], first, last))
        and not _pauses_with_plate(way, first, last)
    ]  # fmt: skip


def _catches_up(steps: Float64, first: int, last: int) -> bool:
    """Whether the step after a stop makes up for the way of the stop."""
    before, after = np.linalg.norm(steps[[first - 1, last + 1]], axis=1)
    return bool(after > _CAUGHT_UP * (last - first + 2) * before > 0.0)


def _pauses_with_plate(way: Float64, first: int, last: int) -> bool:
    """Whether what stands on the ground stands still because the camera does.

    Args:
        way: steps of the object and of the plate, (n, 4) [px].
        first: position of the stop's first frame.
        last: that of its last one.
    """
    around = way[[first - 1, last + 1]]
    usual = float(np.linalg.norm(around[:, 2:], axis=1).min())
    moved = np.linalg.norm(way[first : last + 1, 2:], axis=1).max()
    against = np.linalg.norm(around[:, :2] - around[:, 2:], axis=1).max()
    return bool(moved < _RESTS * usual and against < _WITH_PLATE * usual)
