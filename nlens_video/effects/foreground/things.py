"""Things that move before a background.

A thing stands where its region ends at the bottom: there it meets the ground. Shadows are no
things: they leave the background's colours and texture.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.reservoir import MOVED, largest

_LOW = 0.5  # of the change that makes a thing, for the rest of it
LEAST_AREA = 3e-4
"""Of a thing, by that of the frame [1]."""
_DARKEST, _LIGHTEST = 0.2, 0.97  # light that a shadow leaves [1]
_TINT = 0.2  # a shadow's change of colour, of the light that it takes
_BLUER = 0.25
"""Of that light, by which a shadow is bluer where the sky lights it and the warmer sun does not."""
_TEXTURE = 0.16  # standard deviation of the logarithm of the light that a shadow leaves
_LEAST_FOOT = 4e-3  # area of a foot, by the square of the height of the body above it [1]
_WINDOW = 5
_BORDER = 1  # rows of the picture below a thing that is not cut by its border
_FAR_BELOW, _BESIDE, _SMALLER = 0.9, 0.35, 0.5
"""By the height of a body: how far below it its feet lie, how far to a side, how high they are."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A thing on a frame of the small size.

    Attributes:
        box: around it.
        foot: column and row of the point where it meets the ground [px].
        region: box around the connected region that it is in, of which others may be parts.
        cut: whether it goes on below the frame: its foot is nearer than where it seems to be.
    """

    box: Box
    foot: tuple[float, float]
    region: Box
    cut: bool = False


def things_mask(roots: Float32, background: Float32, noise: Float32) -> Bool:
    """Where (h, w) a picture shows something before the background that is no shadow.

    Args:
        roots: square root of the picture's light (h, w, 3), in the background's exposure.
        background: that of the background (h, w, 3).
        noise: of a picture (h, w) [1].
    """
    change = cv2.blur(roots - background, (3, 3))
    off = largest(np.abs(change))
    limit = np.maximum(np.float32(MOVED), 5.0 * noise)
    strong, weak = off > limit, off > np.float32(_LOW) * limit
    shadow = _shadow(roots, background)
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
    return np.asarray(clean | (changed & _between_body_and_feet(np.asarray(clean))))


def _between_body_and_feet(mask: Bool) -> Bool:
    """Where (h, w) legs are, between a body of a mask (h, w) and its feet.

    Legs that are grey and dark look like a shadow on the ground.
    """
    boxes, areas, _ = _components(mask)
    between = np.zeros(mask.shape, np.uint8)
    for body in boxes:
        for foot, area in zip(boxes, areas, strict=True):
            if _stands_on(body, foot, area):
                waist, sole = body.y1 - 1, foot.y0
                corners = [(body.x0, waist), (body.x1, waist), (foot.x1, sole), (foot.x0, sole)]
                cv2.fillConvexPoly(between, np.array(corners, np.int32), 1)
    return np.asarray(between > 0)


def _components(mask: Bool) -> tuple[list[Box], npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Connected parts of a mask (h, w): boxes, areas (n,) [px], and the part of each pixel (h, w).

    Parts are numbered from 1; the first box is that of 1.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    boxes = [Box(x, y, x + width, y + height) for x, y, width, height, _ in stats[1:count].tolist()]
    areas = np.asarray(stats[1:, cv2.CC_STAT_AREA], np.int32)
    return boxes, areas, np.asarray(labels, np.int32)


def _shadow(roots: Float32, background: Float32) -> Bool:
    """Where (h, w) the light is that of the background in a shadow."""
    tiny = np.float32(2e-3)
    ratio = np.square(cv2.blur(roots, (3, 3)) + tiny) / np.square(
        cv2.blur(background, (3, 3)) + tiny
    )
    logs = np.log(np.maximum(ratio, np.float32(1e-3)))
    mean = (logs[..., 0] + logs[..., 1] + logs[..., 2]) / np.float32(3.0)
    off = logs - mean[..., None]
    bluer = np.clip(0.5 * (off[..., 2] - off[..., 0]), 0.0, np.float32(_BLUER) * np.abs(mean))
    off[..., 0] += bluer
    off[..., 2] -= bluer
    tint = largest(np.abs(off))
    side = (_WINDOW, _WINDOW)
    local = cv2.blur(mean, side)
    spread = np.sqrt(np.maximum(cv2.blur(mean * mean, side) - local * local, 0.0))
    dark = (mean > np.log(_DARKEST)) & (mean < np.log(_LIGHTEST))
    untinted = dark & (tint < _TINT * np.abs(mean) + 0.03)
    inside = (untinted & (spread < _TEXTURE)).astype(np.uint8)
    reach = cv2.dilate(inside, np.ones((_WINDOW + 2, _WINDOW + 2), np.uint8))  # to its edge
    return np.asarray(untinted & (reach > 0), np.bool_)


@dataclass(frozen=True, slots=True)
class Region:
    """Connected pixels of a mask, with the smaller ones below that belong to the same thing.

    Attributes:
        box: around them.
        inside: where they are (h, w) in that box.
    """

    box: Box
    inside: Bool


def find_regions(mask: Bool) -> list[Region]:
    """The regions of a mask (h, w).

    Trousers of the ground's colour part the shoes from the body: what lies under a region, smaller
    and not far below, is a part of it.
    """
    boxes, areas, labels = _components(mask)
    numbers = range(len(boxes))
    owner = list(numbers)
    for lower in sorted(numbers, key=lambda one: boxes[one].y0):
        above = [one for one in numbers if _stands_on(boxes[one], boxes[lower], areas[lower])]
        if above:
            owner[lower] = owner[max(above, key=lambda one: boxes[one].y1)]
    found = []
    for number in dict.fromkeys(owner):
        parts = [one for one in numbers if owner[one] == number]
        if areas[parts].sum() < LEAST_AREA * mask.size:
            continue
        box = boxes[number]
        for one in parts:
            box = box.union(boxes[one])
        at = box.slices_in(Box(0, 0, *mask.shape[::-1]))
        found.append(Region(box, np.isin(labels[at], np.array(parts) + 1)))
    return found


def _stands_on(body: Box, foot: Box, area: int) -> bool:
    """Whether what is in the lower box, of an area [px], may be the foot of the upper one's."""
    below = foot.y0 - body.y1
    beside = max(foot.x0 - body.x1, body.x0 - foot.x1)
    return (
        0 <= below <= _FAR_BELOW * body.height
        and beside <= _BESIDE * body.height
        and foot.height <= _SMALLER * body.height
        and foot.width <= body.width
        and area >= _LEAST_FOOT * body.height * body.height
    )


def find_things(mask: Bool, shown: Bool | None = None) -> list[Seen]:
    """The things of a mask (h, w).

    Args:
        mask: where they are (h, w).
        shown: what the picture shows (h, w); None for all of it.
    """
    return [
        Seen(one.box, _foot(one), one.box, _is_cut(one.box, mask.shape, shown))
        for one in find_regions(mask)
    ]


def _is_cut(box: Box, shape: tuple[int, ...], shown: Bool | None) -> bool:
    """Whether a box ends where the picture does."""
    below = box.y1 + _BORDER
    if below >= shape[0]:
        return True
    return shown is not None and not bool(shown[below, box.x0 : box.x1].all())


def _foot(region: Region) -> tuple[float, float]:
    part, box = region.inside, region.box
    filled = part.sum(axis=1)
    rows = np.flatnonzero(filled >= max(2.0, 0.06 * box.width))
    last = int(rows[-1]) if rows.size else part.shape[0] - 1
    lowest = part[max(0, last - 2) : last + 1].any(axis=0)
    column = float(np.flatnonzero(lowest).mean()) if lowest.any() else 0.5 * box.width
    return box.x0 + column + 0.5, float(box.y0 + last)  # the mask reaches a pixel too far
