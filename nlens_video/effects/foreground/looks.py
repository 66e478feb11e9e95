"""How things look, by which two that meet are told apart: colours in each part of their height."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32

_BINS = 10  # of each channel
_BRIGHTEST = 1.25  # root of light of the last bin
_PARTS = 4  # of the height: head, trunk, legs, feet
_UNSEEN = 0.02  # share of pixels that have any colour at all
_OUTSIDE = 0.2  # of a box' width, by which a thing seldom reaches beyond where it is expected [1]
_DECIDED = 8.0  # pixels that speak for themselves, of those of a window
_WINDOW = 5  # pixels of the small picture that are judged together


@dataclass(slots=True)
class Look:
    """How often each colour occurs in each part of a thing's height.

    Attributes:
        counts: pixels by part and by the roots of light of red, green and blue.
    """

    counts: Float32 = field(
        default_factory=lambda: np.zeros((_PARTS, _BINS, _BINS, _BINS), np.float32)
    )

    def add(self, roots: Float32, mask: Bool, box: Box) -> None:
        """Learn from a picture.

        Args:
            roots: square root of its light (h, w, 3).
            mask: where it shows things (h, w).
            box: of this one, inside the picture.
        """
        at = box.slices_in(Box(0, 0, *mask.shape[::-1]))
        inner = cv2.erode(mask[at].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        bins = _bins(roots[at], box, box)[inner]
        seen = np.bincount(bins, minlength=self.counts.size).reshape(self.counts.shape)
        self.counts += seen.astype(np.float32)

    def likelihood(self, roots: Float32, box: Box, where: Box) -> Float32:
        """How likely the colours of a part of a picture are on the thing (h, w) [1].

        Args:
            roots: square root of the light of that part (h, w, 3).
            box: of the thing.
            where: the part.
        """
        smooth = self.counts
        for axis in (1, 2, 3):
            padded = np.pad(smooth, [(int(axis == one),) * 2 for one in range(4)], mode="edge")
            low, high = (np.take(padded, np.arange(_BINS) + off, axis) for off in (0, 2))
            smooth = 0.25 * low + 0.5 * smooth + 0.25 * high
        total = np.maximum(smooth.sum(axis=(1, 2, 3), keepdims=True), np.float32(1.0))
        shares = (1.0 - _UNSEEN) * smooth / total + _UNSEEN / _BINS**3
        return np.asarray(shares.ravel()[_bins(roots, box, where)], np.float32)


def _bins(roots: Float32, box: Box, where: Box) -> np.ndarray:
    """Number of each pixel's bin (h, w): of its part of a thing's height, and of its colour."""
    rows = np.arange(where.y0, where.y1) + 0.5 - box.y0
    parts = np.clip(rows * (_PARTS / max(1, box.height)), 0, _PARTS - 1).astype(np.int64)
    codes = np.clip(roots * (_BINS / _BRIGHTEST), 0, _BINS - 1).astype(np.int64)
    colours = (codes[..., 0] * _BINS + codes[..., 1]) * _BINS + codes[..., 2]
    return np.asarray(parts[:, None] * _BINS**3 + colours)


def parted(looks: list[Look], boxes: list[Box], roots: Float32, where: Box) -> Float32:
    """Which of several things each pixel shows, as shares (n, h, w) that add up to 1.

    Args:
        looks: of the things.
        boxes: where they are expected.
        roots: square root of the light of a part of the picture (h, w, 3).
        where: that part.
    """
    columns = np.arange(where.x0, where.x1) + 0.5
    scores = []
    for look, box in zip(looks, boxes, strict=True):
        beyond = np.maximum(np.maximum(box.x0 - columns, columns - box.x1), 0.0)
        away = np.square(beyond / (_OUTSIDE * max(1, box.width)))
        colour = np.log(look.likelihood(roots, box, where))
        scores.append(cv2.blur(colour, (_WINDOW, _WINDOW)) - 0.5 * away[None].astype(np.float32))
    best = np.stack(scores)
    best = np.exp(_DECIDED * (best - best.max(axis=0)))
    return np.asarray(best / best.sum(axis=0), np.float32)
