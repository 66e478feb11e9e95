"""Things that move before a background.

A thing stands where its region ends at the bottom: there it meets the ground. Shadows are no
things: they leave the background's colours and texture.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.background import MOVED, gain

_LOW = 0.5  # of the change that makes a thing, for the rest of it
_LEAST_AREA = 3e-4  # of the frame
_DARKEST, _LIGHTEST = 0.2, 0.97  # light that a shadow leaves [1]
_TINT = 0.2  # a shadow's change of colour, of the light that it takes
_TEXTURE = 0.16  # standard deviation of the logarithm of the light that a shadow leaves
_WINDOW = 5


@dataclass(frozen=True, slots=True)
class Seen:
    """A thing on a frame of the small size.

    Attributes:
        box: around it.
        foot: column and row of the point where it meets the ground [px].
        region: box around the connected region that it is in, of which others may be parts.
    """

    box: Box
    foot: tuple[float, float]
    region: Box


def things_mask(roots: Float32, background: Float32, noise: Float32) -> Bool:
    """Where (h, w) a picture shows something before the background that is no shadow.

    Args:
        roots: square root of the picture's light (h, w, 3), in the background's exposure.
        background: that of the background (h, w, 3).
        noise: of a picture (h, w) [1].
    """
    change = cv2.blur(roots - background, (3, 3))
    off = np.abs(change).max(axis=2)
    limit = np.maximum(np.float32(MOVED), 5.0 * noise)
    strong, weak = off > limit, off > np.float32(_LOW) * limit
    shadow = _shadow(roots, background)
    weak &= ~shadow
    strong &= ~shadow
    count, labels = cv2.connectedComponents(weak.astype(np.uint8), connectivity=8)
    kept = np.zeros(count, np.bool_)
    kept[labels[strong]] = True
    kept[0] = False
    mask = cv2.morphologyEx(
        kept[labels].astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 3), np.uint8)
    )
    return np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) > 0)


def _shadow(roots: Float32, background: Float32) -> Bool:
    """Where (h, w) the light is that of the background in a shadow."""
    tiny = np.float32(2e-3)
    ratio = np.square(cv2.blur(roots, (3, 3)) + tiny) / np.square(
        cv2.blur(background, (3, 3)) + tiny
    )
    logs = np.log(np.maximum(ratio, np.float32(1e-3)))
    mean = logs.mean(axis=2)
    tint = np.abs(logs - mean[..., None]).max(axis=2)
    side = (_WINDOW, _WINDOW)
    local = cv2.blur(mean, side)
    spread = np.sqrt(np.maximum(cv2.blur(mean * mean, side) - local * local, 0.0))
    dark = (mean > np.log(_DARKEST)) & (mean < np.log(_LIGHTEST))
    untinted = dark & (tint < _TINT * np.abs(mean) + 0.03)
    inside = (untinted & (spread < _TEXTURE)).astype(np.uint8)
    reach = cv2.dilate(inside, np.ones((_WINDOW + 2, _WINDOW + 2), np.uint8))  # to its edge
    return np.asarray(untinted & (reach > 0), np.bool_)


def find_things(mask: Bool) -> list[Seen]:
    """The things of a mask (h, w)."""
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    found = []
    for number in range(1, count):
        x, y, width, height, area = (int(value) for value in stats[number])
        if area < _LEAST_AREA * mask.size:
            continue
        box = Box(x, y, x + width, y + height)
        found.append(Seen(box, _foot(mask, box), box))
    return found


def _foot(mask: Bool, box: Box) -> tuple[float, float]:
    part = mask[box.y0 : box.y1, box.x0 : box.x1]
    filled = part.sum(axis=1)
    rows = np.flatnonzero(filled >= max(2.0, 0.06 * box.width))
    last = int(rows[-1]) if rows.size else part.shape[0] - 1
    lowest = part[max(0, last - 2) : last + 1].any(axis=0)
    column = float(np.flatnonzero(lowest).mean()) if lowest.any() else 0.5 * box.width
    return box.x0 + column + 0.5, float(box.y0 + last)  # the mask reaches a pixel too far


def normalised(roots: Float32, background: Float32) -> Float32:
    """A picture (h, w, 3) in the background's exposure."""
    return np.asarray(roots / gain(roots, background), np.float32)
