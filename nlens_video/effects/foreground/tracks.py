"""Things followed over a shot, and whether they stand nearer than the object.

The plane of the ground gives the depth of the place where a thing meets it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, UInt8
from nlens_video.effects.foreground.claims import (
    area,
    claimed,
    joined,
    may_hold,
    overlap,
    pieces_of,
)
from nlens_video.effects.foreground.looks import Look
from nlens_video.effects.foreground.meeting import Member, Placed, place
from nlens_video.effects.foreground.things import Seen
from nlens_video.effects.foreground.track import Track

_SMOOTH = 5  # frames before and after one in whose median its foot is
_MARGIN = 0.025  # of a distance by which a thing must be past the object to change its order
_FAR = 0.4  # distance of the object by that of a thing so far behind that no shadow meets it [1]
_LONG = 8  # frames of a thing by which its steadiness is judged
_FADE = 1  # frames before and after a change of the order over which it fades
_MISSING = 8  # frames that a thing may be lost for
_REMEMBERED = 48  # frames before a thing was seen apart on which it is sought
_CODES = 200.0  # of a root of light of 1, on frames that are remembered
_LEAST_EVIDENCE = 8.0  # logarithm, for a thing among others on a frame before it was seen apart
_UNSEEN = 6  # frames on which it may be hidden there
_SAME = 0.1  # common area of a thing on two frames, by the smaller one's [1]
_JUMP = 0.08  # of its height, by which the nearest thing's foot may be beside its region's [1]


@dataclass(frozen=True, slots=True)
class Ordered:
    """A thing on a frame.

    Attributes:
        box: on the small picture.
        region: box around the connected region that it is in.
        before: 1 nearer than the object, 0 behind it, between while that changes [1].
        moved_px: how far it moves from frame to frame [px of the small picture].
        look: its colours.
        disparity: of the ground where it stands [1 / scene unit].
    """

    box: Box
    region: Box
    before: float
    disparity: float
    moved_px: float
    look: Look


class Tracks:
    """Follows things from frame to frame, also while several make one region."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []
        self._recent: deque[_Frame] = deque(maxlen=_REMEMBERED)

    def add(
        self, index: int, seen: list[Seen], feet: list[float], contact: float,
        picture: tuple[Float32, Bool] | None = None,
    ) -> None:  # fmt: skip
        """Take the things of the next frame.

        Args:
            index: of the frame.
            picture: roots of its light (h, w, 3) and mask of the things (h, w), from which their
                looks are learnt.
            seen: the things.
            feet: disparity of the ground where each stands [1 / scene unit].
            contact: that of the object's contact with the ground [1 / scene unit].
        """
        if picture is None:
            self._take(_Frame(index, seen, feet, contact, None))
            return
        codes = np.clip(picture[0] * _CODES + 0.5, 0, 255).astype(np.uint8)
        frame = _Frame(index, seen, feet, contact, (codes, picture[1]))
        self._take(frame)
        for one in self._tracks:
            if one.frames[-1] == index and one.known and not (one.new or one.traced):
                one.traced = True
                self._trace_back(one)
        self._recent.append(frame)

    def _take(self, frame: _Frame) -> None:
        index, seen, picture = frame.index, frame.seen, frame.picture
        free = [one for one in self._tracks if 0 < index - one.frames[-1] <= _MISSING]
        claims = claimed([one for one in free if one.known], index, seen, picture)
        pieces = pieces_of(claims, index, seen)
        taken = {id(one) for parts in claims.values() for one in parts}
        free = [one for one in free if id(one) not in taken]
        alone = set(range(len(seen))) - {at for _, numbers in pieces for at in numbers}
        for number in sorted(alone, key=lambda at: -area(seen[at].box)):
            parts = claims.get(number, [])
            if len(parts) > 1:
                for one, at, stands in _together(parts, frame, seen[number]):
                    foot = frame.feet[number] if stands else math.nan
                    one.meet(index, seen[number], at, foot, frame.contact)
                continue
            best = parts[0] if parts else self._last_at(seen[number].box, free)
            own = [number, *(at for one, numbers in pieces if one is best for at in numbers)]
            lowest = max(own, key=lambda at: seen[at].box.y1)
            thing = joined([seen[at] for at in own])
            best.add(index, thing, frame.feet[lowest], frame.contact, picture)
        for one, numbers in pieces:
            one.pieces[index] = [seen[at].region for at in numbers]

    def _last_at(self, box: Box, free: list[Track]) -> Track:
        """The thing that was last where one is, taken out of those that are free; or a new one."""
        near = [one for one in free if overlap(one.boxes[-1], box) > _SAME]
        best = max(near, key=lambda one: overlap(one.boxes[-1], box), default=None)
        if best is None:
            best = Track()
            self._tracks.append(best)
        else:
            free.remove(best)
        return best

    def _trace_back(self, track: Track) -> None:
        """Seek a thing in regions from which it parted, on the frames before it was seen apart."""
        pending: list[tuple[_Frame, int, list[_At]]] = []
        for frame in reversed(self._recent):
            if frame.index >= track.frames[0]:
                continue
            number = frame.holding(track.expected(frame.index))
            if number is None:
                return
            thing = frame.seen[number]
            others = [one for one in self._tracks if one.is_in(frame.index, thing)]
            if not others:
                return
            ways = _together([*others, track], frame, thing)
            (evidence,) = (at.evidence for one, at, _ in ways if one is track)
            pending.append((frame, number, ways))
            if evidence > _LEAST_EVIDENCE:
                for then, at, found in pending:
                    _rewrite(then, at, found)
                pending.clear()
            elif len(pending) > _UNSEEN:
                return

    def steadiness(self, place: Box, left: float = 0.0) -> float:
        """Share of the frames on which what travels through a place does not jump [1].

        Things count by their area, for so much of the object they hide.

        Args:
            place: on the small picture.
            left: share of frames to come, by those that were seen, on which it would not [1].
        """
        known = [
            one for one in self._tracks
            if len(one.frames) >= _LONG and one.travels
            and any(not box.intersection(place).empty for box in one.boxes)
        ]  # fmt: skip
        areas = [float(np.median([area(box) for box in one.boxes])) for one in known]
        frames = sum(size * len(one.frames) for size, one in zip(areas, known, strict=True))
        jumps = sum(size * one.jumps for size, one in zip(areas, known, strict=True))
        return 1.0 - jumps / ((1.0 + left) * frames) if frames else 1.0

    def ordered(self) -> dict[int, tuple[Ordered, ...]]:
        """The things of each frame in their order with the object."""
        found: dict[int, list[Ordered]] = {}
        for track in self._tracks:
            if len(track.frames) < 3:
                continue
            feet = _smoothed(_between(track))
            nearness = [foot / at for foot, at in zip(feet, track.contacts, strict=True)]
            if max(nearness) < _FAR or not track.travels:
                continue
            states = _orders(nearness)
            for at, (frame, box, region, before, foot) in enumerate(
                zip(track.frames, track.boxes, track.regions, states, feet, strict=True)
            ):
                moved = track.moved_px(at)
                one = Ordered(box, region, before, foot, min(moved, 0.5 * box.width), track.look)
                beside = [replace(one, region=piece) for piece in track.pieces.get(frame, ())]
                found.setdefault(frame, []).extend([one, *beside])
        return {frame: tuple(things) for frame, things in found.items()}


def _between(track: Track) -> list[float]:
    """Its feet; where none was seen, between those before and after."""
    feet = np.array(track.feet)
    known = ~np.isnan(feet)
    frames = np.array(track.frames, float)
    return [float(one) for one in np.interp(frames, frames[known], feet[known])]


def _smoothed(values: list[float]) -> list[float]:
    """Running median."""
    return [
        float(np.median(values[max(0, at - _SMOOTH) : at + _SMOOTH + 1]))
        for at in range(len(values))
    ]


def _orders(nearness: list[float]) -> list[float]:
    """Order on each frame, from 0 behind to 1 before.

    Args:
        nearness: distance of the object by the thing's own, > 1 for a nearer thing [1].
    """
    before = float(np.median(nearness[: 2 * _SMOOTH])) > 1.0
    states = []
    for near in nearness:
        if near > 1.0 + _MARGIN:
            before = True
        elif near < 1.0 - _MARGIN:
            before = False
        states.append(float(before))
    return [
        float(np.mean(states[max(0, at - _FADE) : at + _FADE + 1])) for at in range(len(states))
    ]


@dataclass(frozen=True, slots=True)
class _Frame:
    """What was seen on a frame, as of `Tracks.add`; roots of light as 8-bit codes (h, w, 3)."""

    index: int
    seen: list[Seen]
    feet: list[float]
    contact: float
    kept: tuple[UInt8, Bool] | None

    @property
    def picture(self) -> tuple[Float32, Bool] | None:
        """Roots of light and mask; what is learnt from them can be taken back."""
        if self.kept is None:
            return None
        return self.kept[0].astype(np.float32) / np.float32(_CODES), self.kept[1]

    def holding(self, box: Box) -> int | None:
        """Number of the thing that may hold another one in a box; None if none does."""
        for number, one in enumerate(self.seen):
            if may_hold(one.box, box):
                return number
        return None


_At = tuple[Track, Placed, bool]
"""A thing where it meets others, and whether it stands where their region meets the ground."""


def _together(parts: list[Track], frame: _Frame, thing: Seen) -> list[_At]:
    """Where things are that make one region; the nearest stands where that meets the ground."""
    parts = sorted(parts, key=lambda one: -one.last_foot)
    expected, picture = [one.expected(frame.index) for one in parts], frame.picture
    if picture is None:
        placed = [Placed(box, 1.0, 0.0) for box in expected]
    else:
        members = [Member(one.look, box) for one, box in zip(parts, expected, strict=True)]
        placed = place(members, *picture, thing.box)
    stands = abs(placed[0].box.y1 - thing.box.y1) <= _JUMP * placed[0].box.height
    return [
        (one, at, stands and not number)
        for number, (one, at) in enumerate(zip(parts, placed, strict=True))
    ]


def _rewrite(frame: _Frame, number: int, ways: list[_At]) -> None:
    """Take things on a past frame on which they met unnoticed."""
    thing, picture = frame.seen[number], frame.picture
    for one, at, stands in ways:
        if one.is_apart(frame.index) and picture is not None:
            box = one.boxes[one.frames.index(frame.index)]
            one.look.add(*picture, box, times=-1)
        foot = frame.feet[number] if stands else math.nan
        one.met(frame.index, thing, at, foot, frame.contact)
