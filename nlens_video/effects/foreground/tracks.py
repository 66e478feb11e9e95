"""Things followed over a shot, and whether they stand nearer than the object.

The plane of the ground gives the depth of the place where a thing meets it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.looks import Look
from nlens_video.effects.foreground.things import Seen

_SMOOTH = 5  # frames before and after one in whose median its foot is
_MARGIN = 0.025  # of a distance by which a thing must be past the object to change its order
_FAR = 0.4  # distance of the object by that of a thing so far behind that no shadow meets it [1]
_TRAVELS = 0.6  # of its own size, that a thing must go [1]
_LONG = 8  # frames of a thing by which its steadiness is judged
_JUMP = 0.08  # of its height, by which the foot of a thing that goes its way does not jump [1]
_FADE = 1  # frames before and after a change of the order over which it fades
_KNOWN = 6  # frames by which the motion of a thing is known
_MOST_HIDDEN = 25  # frames for which things that meet are told apart by their motion
_MISSING = 8  # frames that a thing may be lost for


@dataclass(slots=True)
class Track:
    """A thing over the frames of a shot.

    Attributes:
        frames: numbers of the frames.
        boxes: on the small picture.
        regions: boxes around the connected regions that it is in.
        feet: disparity of the ground where it stands [1 / scene unit].
        contacts: disparity of the object's contact with the ground [1 / scene unit].
        cut: on which of the frames its foot is below the frame.
        hidden: frames since it was last seen apart from others [1].
        look: its colours.
    """

    frames: list[int] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    regions: list[Box] = field(default_factory=list)
    feet: list[float] = field(default_factory=list)
    contacts: list[float] = field(default_factory=list)
    cut: list[bool] = field(default_factory=list)
    hidden: int = 0
    look: Look = field(default_factory=Look)

    def add(
        self, index: int, box: Box, region: Box, foot: float, contact: float, *, cut: bool = False
    ) -> None:
        """Take the thing on its next frame."""
        self.frames.append(index)
        self.boxes.append(box)
        self.regions.append(region)
        self.feet.append(foot)
        self.contacts.append(contact)
        self.cut.append(cut)

    @property
    def travels(self) -> bool:
        """Whether it goes anywhere; what stirs in its place belongs to the background."""
        boxes = np.array([(one.x0, one.y0, one.x1, one.y1) for one in self.boxes], float)
        middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
        sizes = np.median(boxes[:, 2:] - boxes[:, :2], axis=0)
        return bool((np.ptp(middles, axis=0) > _TRAVELS * sizes).any())

    @property
    def jumps(self) -> int:
        """Frames on which it jumps from the line on which it goes.

        Its foot does, or its top while the frame's border cuts the foot.
        """
        tops, feet = np.array([(box.y0, box.y1) for box in self.boxes], float).T
        height = float(np.median([box.height for box in self.boxes]))
        cut = np.array(self.cut)
        cut = cut[:-2] & cut[1:-1] & cut[2:]  # a foot that jumps to the border and back is no such
        bends = np.where(cut, np.diff(tops, 2), np.diff(feet, 2))
        return int((np.abs(bends) > _JUMP * height).sum())

    def expected(self, index: int) -> Box:
        """Where it will be on a frame if it goes on as it went."""
        back = max(0, len(self.frames) - 1 - _KNOWN)
        then, now = self.boxes[back], self.boxes[-1]
        passed = max(1, self.frames[-1] - self.frames[back])
        ahead = (index - self.frames[-1]) / passed
        columns = 0.5 * (now.x0 + now.x1 - then.x0 - then.x1)
        rows = 0.5 * (now.y0 + now.y1 - then.y0 - then.y1)
        return now.moved(round(ahead * columns), round(ahead * rows))


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
    """Follows things from frame to frame by where they overlap."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []

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
        free = [one for one in self._tracks if 0 < index - one.frames[-1] <= _MISSING]
        for thing, foot in sorted(
            zip(seen, feet, strict=True), key=lambda pair: -_area(pair[0].box)
        ):
            parts = [one for one in free if _within(one, index, thing.box)]
            if len(parts) > 1:
                for one in parts:
                    free.remove(one)
                    one.hidden += 1
                    one.add(
                        index, one.expected(index), thing.region, one.feet[-1], contact,
                        cut=thing.cut,
                    )  # fmt: skip
                continue
            near = [one for one in free if _overlap(one.boxes[-1], thing.box) > 0.1]
            best = max(near, key=lambda one: _overlap(one.boxes[-1], thing.box), default=None)
            met = [one for one in near if one.hidden]
            if picture is not None and len(met) > 1:  # they part: by their looks
                best = max(met, key=lambda one: _alike(one, thing.box, *picture))
            if best is None:
                best = Track()
                self._tracks.append(best)
            else:
                free.remove(best)
            best.hidden = 0
            best.add(index, thing.box, thing.region, foot, contact, cut=thing.cut)
            if picture is not None:
                best.look.add(*picture, thing.box)

    def steadiness(self, place: Box, left: float = 0.0) -> float:
        """Share of the frames on which what travels through a place does not jump [1].

        Args:
            place: on the small picture.
            left: share of frames to come, by those that were seen, on which it would not [1].
        """
        known = [
            one for one in self._tracks
            if len(one.frames) >= _LONG and one.travels
            and any(not box.intersection(place).empty for box in one.boxes)
        ]  # fmt: skip
        frames = (1.0 + left) * sum(len(one.frames) for one in known)
        return 1.0 - sum(one.jumps for one in known) / frames if frames else 1.0

    def ordered(self) -> dict[int, tuple[Ordered, ...]]:
        """The things of each frame in their order with the object."""
        found: dict[int, list[Ordered]] = {}
        for track in self._tracks:
            if len(track.frames) < 3:
                continue
            feet = _smoothed(track.feet)
            nearness = [foot / at for foot, at in zip(feet, track.contacts, strict=True)]
            if max(nearness) < _FAR or not track.travels:
                continue
            states = _orders(nearness)
            for at, (frame, box, region, before, foot) in enumerate(
                zip(track.frames, track.boxes, track.regions, states, feet, strict=True)
            ):
                last = track.boxes[max(0, at - 1)]
                moved = max(abs(box.x0 - last.x0), abs(box.x1 - last.x1))
                one = Ordered(box, region, before, foot, min(moved, 0.5 * box.width), track.look)
                found.setdefault(frame, []).append(one)
        return {frame: tuple(things) for frame, things in found.items()}


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


def _alike(track: Track, box: Box, roots: Float32, mask: Bool) -> float:
    """How well a track's look explains the things in a box."""
    at = box.slices_in(Box(0, 0, *mask.shape[::-1]))
    return float(np.log(track.look.likelihood(roots[at], box, box))[mask[at]].mean())


def _area(box: Box) -> int:
    return box.width * box.height


def _within(track: Track, index: int, box: Box) -> bool:
    """Whether a thing that was seen apart before is expected in a box around others too."""
    if len(track.frames) - track.hidden < _KNOWN or track.hidden > _MOST_HIDDEN:
        return False
    expected = track.expected(index)
    common = _area(expected.intersection(box))
    return common > 0.6 * _area(expected) and expected.height > 0.4 * box.height


def _overlap(one: Box, other: Box) -> float:
    """Common area by the smaller one's [1]."""
    common = _area(one.intersection(other))
    return common / max(1, min(_area(one), _area(other)))
