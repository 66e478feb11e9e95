"""Data association: which tracks the detections on a frame belong to.

A detection of several tracks is a merged blob: its targets touch or occlude each other. A track may
also have several detections, its fragments.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.detection import Detection
from nlens_video.effects.foreground.track import Track

_MIN_OVERLAP_WITH_PREDICTION = 0.3  # fraction of the predicted box that a detection covers [1]
_MIN_OVERLAP_IN_GROUP = 0.6  # the same where the detection is that of several tracks [1]
_MIN_HEIGHT_IN_GROUP = 0.4  # height of a target, by that of the merged blob it is in [1]
_MIN_COLUMN_OVERLAP = 0.6  # columns that a fragment shares with its target, by the narrower [1]
_MIN_FRAGMENT_OVERLAP = 0.6  # fraction of a fragment that is inside the predicted box [1]
_SPLIT_GATE_PX = 3  # largest gap from a merged blob to the detections it splits into [lowres px]
_POSITION_SCALE = 0.3  # offset that costs 1 of the log-likelihood, by the target's height [1]
_MAX_SPLIT = 4  # most tracks, and detections, whose assignments are all compared


def associate(
    tracks: list[Track], index: int, detections: list[Detection],
    image: tuple[Float32, Bool] | None,
) -> dict[int, list[Track]]:  # fmt: skip
    """The tracks that each detection may belong to, by the number of the detection.

    Groups that were merged on the last frame and split now are assigned by appearance and motion,
    all other tracks by the overlap with their predicted boxes.

    Args:
        tracks: confirmed ones.
        index: number of the frame.
        detections: on that frame.
        image: its roots of light (h, w, 3) and foreground mask (h, w); None if not known.
    """
    assigned: dict[int, list[Track]] = {}
    left = list(tracks)
    if image is not None:
        for group in _merged_groups(tracks):
            gated = [i for i, one in enumerate(detections) if _is_in_gate(group, index, one.box)]
            if 1 < len(gated) <= _MAX_SPLIT:
                assignment = _assign_split(group, index, detections, gated, image)
                for track, i in zip(group, assignment, strict=True):
                    assigned.setdefault(i, []).append(track)
                left = [one for one in left if all(one is not other for other in group)]
    for track in left:
        predicted = _central_box(track.predict(index))
        common = [predicted.intersection(one.box).area for one in detections]
        i = int(np.argmax(common)) if common else 0
        if common and common[i] > _MIN_OVERLAP_WITH_PREDICTION * predicted.area:
            assigned.setdefault(i, []).append(track)
    return {i: _members(candidates, index, detections[i].box) for i, candidates in assigned.items()}


def find_fragments(
    assigned: dict[int, list[Track]], index: int, detections: list[Detection]
) -> list[tuple[Track, list[int]]]:
    """Unassigned detections that are fragments of a track, above or below its main detection.

    Legs of the ground's colour separate the feet from the body.

    Returns:
        Tracks, with the numbers of the detections.
    """
    found: list[tuple[Track, list[int]]] = []
    for i, members in assigned.items():
        for one in (track for track in members if track.motion_known):
            predicted, main = one.predict(index), detections[i].box
            candidates = [
                number for number, other in enumerate(detections)
                if number not in assigned
                and predicted.intersection(other.box).area
                > _MIN_FRAGMENT_OVERLAP * other.box.area
                and min(main.y1, other.box.y1) - max(main.y0, other.box.y0) < 1
            ]  # fmt: skip
            taken = {number for _, numbers in found for number in numbers}
            found.append((one, [number for number in candidates if number not in taken]))
    return [(one, numbers) for one, numbers in found if numbers]


def merge_fragments(fragments: list[Detection]) -> Detection:
    """One detection of several fragments; its blob is that of the first one."""
    box = fragments[0].box
    for one in fragments[1:]:
        box = box.union(one.box)
    lowest = max(fragments, key=lambda one: one.box.y1)
    return Detection(box, lowest.foot, fragments[0].blob_box, lowest.truncated)


def _members(candidates: list[Track], index: int, box: Box) -> list[Track]:
    """Those of several candidates that can be merged in a detection; at least the likeliest."""
    if len(candidates) == 1:
        return candidates
    predicted = [(one, one.predict(index)) for one in candidates]
    inside = [one for one, its_box in predicted if may_contain(box, its_box)]
    inside = [
        one for one in inside
        if not (not one.motion_known and one.isolated[-1] and _is_fragment(one, inside))
    ]  # fmt: skip
    return inside or [max(predicted, key=lambda pair: _iou(pair[1], box))[0]]


def may_contain(blob_box: Box, box: Box) -> bool:
    """Whether the blob of a bounding box may be a merged one that contains a target's box."""
    central = _central_box(box)
    common = central.intersection(blob_box).area
    return (
        common > _MIN_OVERLAP_IN_GROUP * central.area
        and box.height > _MIN_HEIGHT_IN_GROUP * blob_box.height
    )


def _central_box(box: Box) -> Box:
    """The middle half of a box' columns; swinging limbs enter and leave the rest."""
    off = box.width // 4
    return Box(box.x0 + off, box.y0, box.x1 - off, box.y1)


def _is_fragment(track: Track, others: list[Track]) -> bool:
    """Whether a track is a fragment of another one: it lies above or below it."""
    box = track.boxes[-1]
    for one in others:
        other = one.boxes[-1]
        common = min(box.x1, other.x1) - max(box.x0, other.x0)
        if one is not track and common > _MIN_COLUMN_OVERLAP * min(box.width, other.width):
            return True
    return False


def _merged_groups(tracks: list[Track]) -> list[list[Track]]:
    """Groups of tracks that share a merged blob on their last frame."""
    merged: dict[tuple[int, Box], list[Track]] = {}
    for one in tracks:
        if not one.isolated[-1]:
            merged.setdefault((one.frames[-1], one.blob_boxes[-1]), []).append(one)
    return [group for group in merged.values() if 1 < len(group) <= _MAX_SPLIT]


def _is_in_gate(group: list[Track], index: int, box: Box) -> bool:
    """Whether a detection may be split off a group: near its blob, in the rows of a member."""
    gate = group[0].blob_boxes[-1].expanded(_SPLIT_GATE_PX)
    if box.intersection(gate).empty:
        return False
    predicted = [one.predict(index) for one in group]
    return any(
        min(box.y1, one.y1) - max(box.y0, one.y0) > _MIN_OVERLAP_IN_GROUP * one.height
        for one in predicted
    )


def _assign_split(
    group: list[Track], index: int, detections: list[Detection], gated: list[int],
    image: tuple[Float32, Bool],
) -> tuple[int, ...]:  # fmt: skip
    """The detection of each track of a group that splits.

    Of all assignments, that of least cost: distance from the prediction less the mean
    log-likelihood of the colours.
    """
    roots, mask = image
    frame_box = Box(0, 0, *mask.shape[::-1])
    costs: list[dict[int, float]] = []
    for track in group:
        predicted = track.predict(index)
        each = {}
        for i in gated:
            box = detections[i].box
            crop = box.slices_in(frame_box)
            colours = track.appearance.colour_likelihood(roots[crop], box, box)
            likelihood = float(np.log(colours)[mask[crop]].mean())
            across = max(0.0, abs(_centre_x(box) - _centre_x(predicted)) - 0.5 * box.width)
            offset = across + abs(box.y1 - predicted.y1) + abs(box.y0 - predicted.y0)
            each[i] = offset / (_POSITION_SCALE * predicted.height) - likelihood
        costs.append(each)
    assignments = [
        one for one in product(gated, repeat=len(group))
        if len(set(one)) == _assigned_count(group, gated)
    ]  # fmt: skip
    return min(
        assignments,
        key=lambda one: sum(cost[i] for cost, i in zip(costs, one, strict=True)),
    )


def _assigned_count(group: list[Track], gated: list[int]) -> int:
    return min(len(group), len(gated))


def _centre_x(box: Box) -> float:
    return 0.5 * (box.x0 + box.x1)


def overlap_fraction(one: Box, other: Box) -> float:
    """Area of the intersection, by that of the smaller box [1]."""
    return one.intersection(other).area / max(1, min(one.area, other.area))


def _iou(one: Box, other: Box) -> float:
    """Intersection over union [1]."""
    common = one.intersection(other).area
    return common / max(1, one.area + other.area - common)
