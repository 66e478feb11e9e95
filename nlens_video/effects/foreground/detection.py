"""Foreground detection by background subtraction: foreground mask, blobs and detections.

A target touches the ground at the bottom of its blob. Shadows are background: they leave its colour
and texture as they are.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.frame_sampler import MIN_CHANGE
from nlens_video.kernels.channels import channel_max

_WEAK_THRESHOLD = 0.5  # lower threshold of the hysteresis, by the upper one [1]
MIN_BLOB_AREA = 3e-4
"""Least area of a blob, by the area of the frame [1]."""
_MIN_SHADOW_RATIO, _MAX_SHADOW_RATIO = 0.2, 0.97  # light in a shadow, by the light outside it [1]
_MAX_TINT = 0.2  # change of colour in a shadow, by the logarithm of the light it leaves [1]
_MAX_BLUE_SHIFT = 0.25
"""Shift to blue in a shadow, by that logarithm [1]: the sky lights it, the warmer sun does not."""
_MAX_TEXTURE = 0.16  # standard deviation of the logarithm of the light that a shadow leaves [1]
_MIN_FOOT_AREA = 4e-3  # area of a foot, by the square of the height of the body above it [1]
_TEXTURE_WINDOW_PX = 5  # side of the window in which that deviation is measured
_BORDER_PX = 1  # rows of the picture below a blob that does not reach its border
_MAX_FOOT_GAP, _MAX_FOOT_OFFSET, _MAX_FOOT_HEIGHT = 0.9, 0.35, 0.5
"""Of a foot, by the height of the body above it [1]: gap below it, offset to a side, height."""


class Detection(Struct, frozen=True):
    """A detected blob on a frame at low resolution, or the union of several ones.

    Attributes:
        box: bounding box of all blobs.
        foot: column and row of the lowest point, where it touches the ground [px].
        blob_box: bounding box of the main blob.
        truncated: whether the lower border of the frame cuts it; its foot is then nearer than it
            appears.
    """

    box: Box
    foot: tuple[float, float]
    blob_box: Box
    truncated: bool = False


def foreground_mask(roots: Float32, background: Float32, noise: Float32) -> Bool:
    """Where (h, w) a frame differs from the background, shadows excluded.

    Thresholding with hysteresis: weak differences count where they connect to strong ones.

    Args:
        roots: square root of the frame's light (h, w, 3), in the background's exposure.
        background: that of the background (h, w, 3).
        noise: standard deviation of a frame's roots (h, w) [1].
    """
    change = cv2.blur(roots - background, (3, 3))
    difference = channel_max(np.abs(change))
    limit = np.maximum(np.float32(MIN_CHANGE), 5.0 * noise)
    strong, weak = difference > limit, difference > np.float32(_WEAK_THRESHOLD) * limit
    shadow = _shadow_mask(roots, background)
    changed = weak
    weak = weak & ~shadow
    strong &= ~shadow
    count, labels = cv2.connectedComponents(weak.astype(np.uint8), connectivity=8)
    kept = np.zeros(count, np.bool_)
    kept[labels[strong]] = True
    kept[0] = False
    mask = cv2.morphologyEx(
        kept[labels].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 3), np.uint8)
    )
    clean = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) > 0
    return np.asarray(clean | (changed & _leg_mask(np.asarray(clean))))


def _leg_mask(mask: Bool) -> Bool:
    """Where (h, w) legs may be, between the bodies of a mask (h, w) and their feet.

    Grey, dark legs pass for a shadow on the ground.
    """
    boxes, areas, _ = _connected_components(mask)
    between = np.zeros(mask.shape, np.uint8)
    for body in boxes:
        for foot, area in zip(boxes, areas, strict=True):
            if _is_foot_of(body, foot, area):
                waist, sole = body.y1 - 1, foot.y0
                corners = [(body.x0, waist), (body.x1, waist), (foot.x1, sole), (foot.x0, sole)]
                cv2.fillConvexPoly(between, np.array(corners, np.int32), 1)
    return np.asarray(between > 0)


def _connected_components(
    mask: Bool,
) -> tuple[list[Box], npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Connected components of a mask (h, w): boxes, areas (n,) [px] and label image (h, w).

    Label 0 is the background; label i + 1 belongs to box i.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    boxes = [Box(x, y, x + width, y + height) for x, y, width, height, _ in stats[1:count].tolist()]
    areas = np.asarray(stats[1:, cv2.CC_STAT_AREA], np.int32)
    return boxes, areas, np.asarray(labels, np.int32)


def _shadow_mask(roots: Float32, background: Float32) -> Bool:
    """Where (h, w) a frame shows the background in a shadow."""
    tiny = np.float32(2e-3)
    ratio = np.square(cv2.blur(roots, (3, 3)) + tiny) / np.square(
        cv2.blur(background, (3, 3)) + tiny
    )
    logs = np.log(np.maximum(ratio, np.float32(1e-3)))
    mean = (logs[..., 0] + logs[..., 1] + logs[..., 2]) / np.float32(3.0)
    chroma = logs - mean[..., None]
    bluer = np.clip(
        0.5 * (chroma[..., 2] - chroma[..., 0]), 0.0, np.float32(_MAX_BLUE_SHIFT) * np.abs(mean)
    )
    chroma[..., 0] += bluer
    chroma[..., 2] -= bluer
    tint = channel_max(np.abs(chroma))
    side = (_TEXTURE_WINDOW_PX, _TEXTURE_WINDOW_PX)
    local = cv2.blur(mean, side)
    deviation = np.sqrt(np.maximum(cv2.blur(mean * mean, side) - local * local, 0.0))
    darker = (mean > np.log(_MIN_SHADOW_RATIO)) & (mean < np.log(_MAX_SHADOW_RATIO))
    untinted = darker & (tint < _MAX_TINT * np.abs(mean) + 0.03)
    inside = (untinted & (deviation < _MAX_TEXTURE)).astype(np.uint8)
    # a window at a shadow's edge has more texture: grow to that edge
    grown = cv2.dilate(inside, np.ones((_TEXTURE_WINDOW_PX + 2, _TEXTURE_WINDOW_PX + 2), np.uint8))
    return np.asarray(untinted & (grown > 0), np.bool_)


class Blob(Struct, frozen=True):
    """A connected component of the foreground mask, with the feet that belong to it.

    Attributes:
        box: its bounding box.
        mask: its pixels (h, w) in that box.
    """

    box: Box
    mask: Bool


def find_blobs(mask: Bool) -> list[Blob]:
    """The blobs of a foreground mask (h, w).

    Trousers of the ground's colour separate the shoes from the body: a smaller component not far
    below another one is a part of it.
    """
    boxes, areas, labels = _connected_components(mask)
    numbers = range(len(boxes))
    owner = list(numbers)
    for lower in sorted(numbers, key=lambda i: boxes[i].y0):
        above = [i for i in numbers if _is_foot_of(boxes[i], boxes[lower], areas[lower])]
        if above:
            owner[lower] = owner[max(above, key=lambda i: boxes[i].y1)]
    found = []
    for number in dict.fromkeys(owner):
        parts = [i for i in numbers if owner[i] == number]
        if areas[parts].sum() < MIN_BLOB_AREA * mask.size:
            continue
        box = boxes[number]
        for i in parts:
            box = box.union(boxes[i])
        crop = box.slices_in(Box(0, 0, *mask.shape[::-1]))
        found.append(Blob(box, np.isin(labels[crop], np.array(parts) + 1)))
    return found


def _is_foot_of(body: Box, foot: Box, area: int) -> bool:
    """Whether a component below another one, of an area [px], may be the foot of that body."""
    gap = foot.y0 - body.y1
    offset = max(foot.x0 - body.x1, body.x0 - foot.x1)
    return (
        0 <= gap <= _MAX_FOOT_GAP * body.height
        and offset <= _MAX_FOOT_OFFSET * body.height
        and foot.height <= _MAX_FOOT_HEIGHT * body.height
        and foot.width <= body.width
        and area >= _MIN_FOOT_AREA * body.height * body.height
    )


def detect(mask: Bool, valid: Bool | None = None) -> list[Detection]:
    """One detection for each blob.

    Args:
        mask: the foreground mask (h, w).
        valid: which pixels the frame shows (h, w); None for all.
    """
    return [
        Detection(one.box, _foot(one), one.box, _is_truncated(one.box, mask.shape, valid))
        for one in find_blobs(mask)
    ]


def _is_truncated(box: Box, shape: tuple[int, ...], valid: Bool | None) -> bool:
    """Whether a box ends at the lower border of the frame."""
    below = box.y1 + _BORDER_PX
    if below >= shape[0]:
        return True
    return valid is not None and not bool(valid[below, box.x0 : box.x1].all())


def _foot(blob: Blob) -> tuple[float, float]:
    part, box = blob.mask, blob.box
    widths = part.sum(axis=1)
    rows = np.flatnonzero(widths >= max(2.0, 0.06 * box.width))
    last = int(rows[-1]) if rows.size else part.shape[0] - 1
    lowest = part[max(0, last - 2) : last + 1].any(axis=0)
    column = float(np.flatnonzero(lowest).mean()) if lowest.any() else 0.5 * box.width
    return box.x0 + column + 0.5, float(box.y0 + last)  # the blurred mask is a pixel too large
