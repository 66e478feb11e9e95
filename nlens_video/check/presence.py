"""Frames on which an object is missing, or stands still while it moves before and after.

It is missing where it is gone, or there, at once at its full size: what leaves the frame,
shrinks, fades or goes behind something is smaller before it is gone.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right

import numpy as np
from msgspec import Struct

from nlens_video.check.measure import Measures
from nlens_video.check.regions import Track, beside
from nlens_video.check.series import freezes
from nlens_video.check.verdict import Finding, at
from nlens_video.core.layers import Float64

_FULL = 0.75  # share of its usual coverage at which an object is there as a whole [1]
_USUAL = 4  # frames whose coverage is the usual one
_STRONG_BLOCKS = 6  # beyond twice the tolerance; fewer come and go by grain and encoding
_STEPS = 2.0  # of its own within which it may have left the frame, as what speeds up does
_STILL = 0.75  # largest change of a still block of the result from frame to frame [level]
_SHORT = 5  # frames; a longer stop is meant, unless the object then is where it would have been
_CAUGHT_UP = 0.5  # share of the missed way [1]
_RESTS = 0.25  # share of the plate's motion around that it has where the camera pauses [1]
_WITH_PLATE = 0.5  # share of the plate's motion by which what stands on the ground is off it [1]


class _Seen(Struct, frozen=True):
    """An object on a frame beside others that lack it: `back` leads away from these."""

    track: Track
    place: int
    back: int


def judge_presence(objects: list[Track], measures: Measures) -> list[Finding]:
    """Frames without an object that was there, or is there, at once."""
    compared, every = measures.compared, measures.tracks.all()
    found = []
    for chain in _chains(objects):
        for before, after in _gaps(chain):
            lacking = _between(compared, before, after)
            sides = [one for one in (before, after) if one is not None]
            if not lacking or any(beside(one.track.disturbed, *_ends(lacking)) for one in sides):
                continue
            if any(_is_at_once(one, lacking, measures.cuts, every) for one in sides):
                switched = "off" if after is None else "on"
                open_ended = f", or switched {switched} at once" if len(sides) == 1 else ""
                found.append(at("pop", _ends(lacking), 1.0, f"the object is missing{open_ended}"))
    return found


def _chains(objects: list[Track]) -> list[list[Track]]:
    """Tracks that follow each other, each chain taken for one object."""
    chains: list[list[Track]] = []
    for track in sorted(objects, key=lambda one: one.first):
        ended = [chain for chain in chains if chain[-1].last < track.first]
        if ended:
            max(ended, key=lambda chain: chain[-1].last).append(track)
        else:
            chains.append([track])
    return chains


def _gaps(chain: list[Track]) -> list[tuple[_Seen | None, _Seen | None]]:
    """The object before and after each gap; None at the clip's beginning and end."""
    shown = [(track, place) for track in chain for place in range(len(track.frames))]
    inside = [
        (_Seen(*before, -1), _Seen(*after, 1))
        for before, after in zip(shown, shown[1:], strict=False)
        if after[0].frames[after[1]] > before[0].frames[before[1]] + 1
    ]
    return [(None, _Seen(*shown[0], 1)), *inside, (_Seen(*shown[-1], -1), None)]


def _between(compared: array[int], before: _Seen | None, after: _Seen | None) -> array[int]:
    """Frames of the result that were compared, from one that shows the object to the next."""
    first = 0 if before is None else bisect_right(compared, before.track.frames[before.place])
    end = len(compared)
    if after is not None:
        end = bisect_left(compared, after.track.frames[after.place])
    return compared[first:end]


def _ends(frames: array[int]) -> tuple[int, int]:
    return frames[0], frames[-1]


def _is_at_once(seen: _Seen, lacking: array[int], cuts: set[int], every: list[Track]) -> bool:
    """Whether an object that is there as a whole, inside the frame, is not on the next frame."""
    track, place = seen.track, seen.place
    around = range(place + seen.back, place + seen.back * (_USUAL + 1), seen.back)
    usual = [track.area[one] for one in around if 0 <= one < len(track.frames)]
    whole = bool(usual) and track.area[place] >= _FULL * float(np.median(usual))
    begins_shot = lacking[0] if seen.back < 0 else track.frames[place]
    nearest = lacking[0] if seen.back < 0 else lacking[-1]
    return (
        whole
        and track.strong[place] >= _STRONG_BLOCKS
        and begins_shot not in cuts
        and not _may_have_left(seen)
        and not any(_is_at(one, nearest, track.box_at(place)) for one in every)
    )


def _may_have_left(seen: _Seen) -> bool:
    """Whether some of the object's steps take all of it out of the frame."""
    track, place = seen.track, seen.place
    x0, y0, x1, y1 = track.box_at(place)
    across = down = 0
    if 0 <= place + seen.back < len(track.frames):
        other = track.box_at(place + seen.back)
        across = max(abs(x0 - other[0]), abs(x1 - other[2]))
        down = max(abs(y0 - other[1]), abs(y1 - other[3]))
    rows, columns = track.mask.shape
    beyond_side = min(x1, columns - x0) <= _STEPS * across
    return bool(beyond_side or min(y1, rows - y0) <= _STEPS * down)


def _is_at(track: Track, index: int, box: tuple[int, int, int, int]) -> bool:
    """Whether a track has a region on a frame at a place, as where two objects meet."""
    place = bisect_left(track.frames, index)
    if place == len(track.frames) or track.frames[place] != index:
        return False
    x0, y0, x1, y1 = track.box_at(place)
    return x0 < box[2] and box[0] < x1 and y0 < box[3] and box[1] < y1


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
