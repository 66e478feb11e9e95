"""Multi-target tracking over a shot, and the depth order of the targets and the object.

The disparity of the ground at a target's foot is the target's; it is compared with that of the
object's contact with the ground.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, Box, Float32, UInt8
from nlens_video.effects.foreground.appearance import AppearanceModel
from nlens_video.effects.foreground.association import (
    associate,
    find_fragments,
    may_contain,
    merge_fragments,
    overlap_fraction,
)
from nlens_video.effects.foreground.detection import Detection
from nlens_video.effects.foreground.mutual_occlusion import Localization, MergedTarget, localize
from nlens_video.effects.foreground.track import Track, depth_order, smoothed_feet

_MAX_GAP_FRAMES = 8  # frames without a detection after which a track ends
_MIN_OVERLAP_WITH_LAST = 0.1  # of a detection and the track's last box, by the smaller one [1]
_MAX_FOOT_OFFSET = 0.08  # from the nearest target's foot to its blob's, by its height [1]
_BACKTRACK_FRAMES = 48  # frames that are kept to backtrack a target that splits off
_MIN_EVIDENCE = 8.0  # log-likelihood ratio for a target on a frame that is backtracked
_MAX_UNSEEN_FRAMES = 6  # frames without that evidence after which backtracking ends
_CODE_SCALE = 200.0  # code of a square root of light of 1, on frames that are kept
_MIN_NEARNESS = 0.4  # distance of the object, by that of the farthest target that matters [1]
_MIN_STEADY_FRAMES = 8  # frames of a track from which its steadiness is judged


class TrackState(Struct, frozen=True):
    """A target on one frame.

    Attributes:
        box: its box at low resolution.
        blob_box: bounding box of the blob that it is in.
        in_front: 1 in front of the object, 0 behind it, between while that changes [1].
        disparity: of the ground at its foot [1 / scene unit].
        displacement_px: sideways, from the frame before [lowres px].
        appearance: its appearance model.
    """

    box: Box
    blob_box: Box
    in_front: float
    disparity: float
    displacement_px: float
    appearance: AppearanceModel


class Tracker:
    """Tracks targets from frame to frame, through merged blobs as well."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []
        self._recent: deque[_Frame] = deque(maxlen=_BACKTRACK_FRAMES)
        self._skipped: list[int] = []

    def add(
        self, index: int, detections: list[Detection], feet: list[float], contact: float,
        image: tuple[Float32, Bool] | None = None,
    ) -> None:  # fmt: skip
        """Add the detections on the next frame.

        Args:
            index: number of the frame.
            detections: on the frame.
            feet: disparity of the ground at the foot of each [1 / scene unit].
            contact: that of the object's contact with the ground [1 / scene unit].
            image: roots of the frame's light (h, w, 3) and its foreground mask (h, w), from which
                appearances are learnt.
        """
        if image is None:
            self._update(_Frame(index, detections, feet, contact, None))
            return
        codes = np.clip(image[0] * _CODE_SCALE + 0.5, 0, 255).astype(np.uint8)
        frame = _Frame(index, detections, feet, contact, (codes, image[1]))
        self._update(frame)
        for one in self._tracks:
            if (
                one.frames[-1] == index
                and one.confirmed
                and one.motion_known
                and not one.backtracked
            ):
                one.backtracked = True
                self._backtrack(one)
        self._recent.append(frame)

    def skip(self, index: int) -> None:
        """Skip the next frame, which shows nothing: targets are placed on it by their motion.

        Args:
            index: number of the frame [1].
        """
        self._skipped.append(index)

    def _update(self, frame: _Frame) -> None:
        index, detections, image = frame.index, frame.detections, frame.image
        free = [one for one in self._tracks if 0 < index - one.frames[-1] <= _MAX_GAP_FRAMES]
        assigned = associate([one for one in free if one.confirmed], index, detections, image)
        fragments = find_fragments(assigned, index, detections)
        taken = {id(one) for members in assigned.values() for one in members}
        free = [one for one in free if id(one) not in taken]
        main = set(range(len(detections))) - {i for _, numbers in fragments for i in numbers}
        for number in sorted(main, key=lambda i: -detections[i].box.area):
            members = assigned.get(number, [])
            if len(members) > 1:
                for one, location, shows_foot in _localize(members, frame, detections[number]):
                    foot = frame.feet[number] if shows_foot else math.nan
                    one.add_merged(index, detections[number], location, foot, frame.contact)
                continue
            best = members[0] if members else self._nearest_track(detections[number].box, free)
            own = [number, *(i for one, numbers in fragments if one is best for i in numbers)]
            lowest = max(own, key=lambda i: detections[i].box.y1)
            detection = merge_fragments([detections[i] for i in own])
            best.add_isolated(index, detection, frame.feet[lowest], frame.contact, image)
        for one, numbers in fragments:
            one.fragments[index] = [detections[i].blob_box for i in numbers]

    def _nearest_track(self, box: Box, free: list[Track]) -> Track:
        """The free track whose last box overlaps a detection most, no longer free; or a new one."""
        near = [
            one for one in free if overlap_fraction(one.boxes[-1], box) > _MIN_OVERLAP_WITH_LAST
        ]
        best = max(near, key=lambda one: overlap_fraction(one.boxes[-1], box), default=None)
        if best is None:
            best = Track()
            self._tracks.append(best)
        else:
            free.remove(best)
        return best

    def _backtrack(self, track: Track) -> None:
        """Find a target in merged blobs on the frames before it was first isolated."""
        pending: list[tuple[_Frame, int, list[_MemberLocation]]] = []
        for frame in reversed(self._recent):
            if frame.index >= track.frames[0]:
                continue
            number = frame.blob_containing(track.predict(frame.index))
            if number is None:
                return
            blob = frame.detections[number]
            others = [one for one in self._tracks if one.is_in_blob(frame.index, blob)]
            if not others:
                return
            locations = _localize([*others, track], frame, blob)
            (evidence,) = (location.evidence for one, location, _ in locations if one is track)
            pending.append((frame, number, locations))
            if evidence > _MIN_EVIDENCE:
                for past, i, found in pending:
                    _revise(past, i, found)
                pending.clear()
            elif len(pending) > _MAX_UNSEEN_FRAMES:
                return

    def steadiness(self, region: Box, remaining: float = 0.0) -> float:
        """Fraction of the frames on which what travels through a region does not jump [1].

        Targets are weighted by their area, for so much of the object they hide.

        Args:
            region: of the frame at low resolution.
            remaining: frames to come, by those seen so far, taken to be without jumps [1].
        """
        long = [one for one in self._tracks if len(one.frames) >= _MIN_STEADY_FRAMES]
        judged = [way for one in long if (way := one.passage(region)) is not None]
        frames = sum(area * count for area, count, _ in judged)
        jumps = sum(area * jumped for area, _, jumped in judged)
        return 1.0 - jumps / ((1.0 + remaining) * frames) if frames else 1.0

    def states(self) -> dict[int, tuple[TrackState, ...]]:
        """The targets on each frame, with their depth order."""
        found: dict[int, list[TrackState]] = {}
        for track in self._tracks:
            if len(track.frames) < 3:
                continue
            feet = smoothed_feet(track)
            nearness = [
                foot / contact
                for foot, contact in zip(feet, track.contact_disparities, strict=True)
            ]
            if max(nearness) < _MIN_NEARNESS or not track.travels:
                continue
            order = depth_order(nearness)
            for i, (frame, box, blob_box, in_front, foot) in enumerate(
                zip(track.frames, track.boxes, track.blob_boxes, order, feet, strict=True)
            ):
                moved = min(track.displacement_px(i), 0.5 * box.width)
                state = TrackState(box, blob_box, in_front, foot, moved, track.appearance)
                fragments = [replace(state, blob_box=one) for one in track.fragments.get(frame, ())]
                found.setdefault(frame, []).extend([state, *fragments])
            for frame in self._skipped:
                i = int(np.argmin(np.abs(np.array(track.frames) - frame)))
                if abs(track.frames[i] - frame) <= _MAX_GAP_FRAMES:
                    box = track.predict(frame)
                    state = TrackState(box, box, order[i], feet[i], 0.0, track.appearance)
                    found.setdefault(frame, []).append(state)
        return {frame: tuple(states) for frame, states in found.items()}


class _Frame(Struct, frozen=True):
    """Arguments of `Tracker.add`, with the roots of light as 8-bit codes (h, w, 3)."""

    index: int
    detections: list[Detection]
    feet: list[float]
    contact: float
    codes: tuple[UInt8, Bool] | None

    @property
    def image(self) -> tuple[Float32, Bool] | None:
        """Roots of light and foreground mask, the same each time: what is learnt can be removed."""
        if self.codes is None:
            return None
        return self.codes[0].astype(np.float32) / np.float32(_CODE_SCALE), self.codes[1]

    def blob_containing(self, box: Box) -> int | None:
        """Number of the first blob that may contain a target's box; None if none does."""
        for number, one in enumerate(self.detections):
            if may_contain(one.box, box):
                return number
        return None


_MemberLocation = tuple[Track, Localization, bool]
"""Where a track is in a merged blob, and whether the blob's foot is its own."""


def _localize(members: list[Track], frame: _Frame, blob: Detection) -> list[_MemberLocation]:
    """Localise the tracks of a merged blob; the foot is that of the nearest one."""
    members = sorted(members, key=lambda one: -one.last_foot_disparity)
    predicted, image = [one.predict(frame.index) for one in members], frame.image
    if image is None:
        found = [Localization(box, 1.0, 0.0) for box in predicted]
    else:
        targets = [
            MergedTarget(one.appearance, box) for one, box in zip(members, predicted, strict=True)
        ]
        found = localize(targets, *image, blob.box)
    shows_foot = abs(found[0].box.y1 - blob.box.y1) <= _MAX_FOOT_OFFSET * found[0].box.height
    return [
        (one, location, shows_foot and not number)
        for number, (one, location) in enumerate(zip(members, found, strict=True))
    ]


def _revise(frame: _Frame, number: int, locations: list[_MemberLocation]) -> None:
    """Make a blob of a past frame a merged one, and remove what was learnt from it."""
    blob, image = frame.detections[number], frame.image
    for one, location, shows_foot in locations:
        if one.is_isolated(frame.index) and image is not None:
            box = one.boxes[one.frames.index(frame.index)]
            one.appearance.update(*image, box, weight=-1)
        foot = frame.feet[number] if shows_foot else math.nan
        one.revise_as_merged(frame.index, blob, location, foot, frame.contact)
