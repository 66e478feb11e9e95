"""How things look, by which those that meet are told apart: colours by height, and outline."""

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
_OUTLINE = 0.1  # weight of the outline beside the colours
_DECIDED = 8.0  # pixels that speak for themselves, of those of a window
_WINDOW = 5  # pixels of the small picture that are judged together
_SHAPE = 64  # rows and columns of an outline
_WIDE = 1.2  # width of an outline, by the larger side of the thing's box [1]
_LEAST_COVER = 0.03  # of a pixel far from an outline [1]


@dataclass(slots=True)
class Look:
    """How often each colour occurs in each part of a thing's height, and where it covers pixels.

    Attributes:
        counts: pixels by part and by the roots of light of red, green and blue.
        shape: pictures on which it covers each part of its surroundings (_SHAPE, _SHAPE) [1]; rows
            by the height of its box, columns around the middle of its upper half.
        pictures: that it was learnt from [1].
    """

    counts: Float32 = field(
        default_factory=lambda: np.zeros((_PARTS, _BINS, _BINS, _BINS), np.float32)
    )
    shape: Float32 = field(default_factory=lambda: np.zeros((_SHAPE, _SHAPE), np.float32))
    pictures: int = 0

    def add(self, roots: Float32, mask: Bool, box: Box, *, times: int = 1) -> None:
        """Learn from a picture.

        Args:
            roots: square root of its light (h, w, 3).
            mask: where it shows things (h, w).
            box: of this one, inside the picture.
            times: how often; -1 takes back what was learnt from it.
        """
        at = box.slices_in(Box(0, 0, *mask.shape[::-1]))
        inner = cv2.erode(mask[at].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        bins = _bins(roots[at], box, box)[inner]
        seen = np.bincount(bins, minlength=self.counts.size).reshape(self.counts.shape)
        self.counts += times * seen.astype(np.float32)
        rows, columns = np.meshgrid(*_grid(box, middle(mask, box)), indexing="ij")
        shape = cv2.remap(
            mask[at].astype(np.float32), (columns - box.x0).astype(np.float32),
            (rows - box.y0).astype(np.float32), cv2.INTER_LINEAR, borderValue=0.0,
        )  # fmt: skip
        self.pictures += times
        self.shape += times * shape

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

    def cover(self, box: Box, where: Box) -> Float32:
        """How likely the thing covers the pixels of a part of a picture (h, w) [1].

        Args:
            box: of the thing, around the middle of its upper half.
            where: the part.
        """
        rows, columns = _grid(box, 0.5 * (box.x0 + box.x1 - 1))
        y = (np.arange(where.y0, where.y1) - rows[0]) / (rows[1] - rows[0])
        x = (np.arange(where.x0, where.x1) - columns[0]) / (columns[1] - columns[0])
        across, down = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
        found = cv2.remap(self.shape, across, down, cv2.INTER_LINEAR, borderValue=0.0)
        found = found / np.float32(max(1, self.pictures))
        return np.asarray(np.clip(found, _LEAST_COVER, 1.0 - _LEAST_COVER), np.float32)


def middle(mask: Bool, box: Box) -> float:
    """Column of the middle of the upper half of a thing [px]; limbs that swing do not move it."""
    at = box.slices_in(Box(0, 0, *mask.shape[::-1]))
    part = mask[at][: max(1, box.height // 2)]
    columns = np.flatnonzero(part.any(axis=0))
    if not columns.size:
        return 0.5 * (box.x0 + box.x1 - 1)
    weights = part.sum(axis=0)[columns]
    return box.x0 + float((columns * weights).sum() / weights.sum())


def _grid(box: Box, column: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a picture at which an outline is kept [px]."""
    side = _WIDE * max(box.width, box.height, 2)
    rows = box.y0 + (np.arange(_SHAPE) + 0.5) * (max(box.height, 2) / _SHAPE) - 0.5
    return rows, column + ((np.arange(_SHAPE) + 0.5) / _SHAPE - 0.5) * side


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
        looks: of the things, the farthest first.
        boxes: where they are expected, each around the middle of the thing's upper half.
        roots: square root of the light of a part of the picture (h, w, 3).
        where: that part.
    """
    columns = np.arange(where.x0, where.x1) + 0.5
    scores: list[Float32] = []
    open_share = np.ones(roots.shape[:2], np.float32)  # that nothing nearer covers
    for look, box in zip(reversed(looks), reversed(boxes), strict=True):
        cover = look.cover(box, where)
        colour = cv2.blur(np.log(look.likelihood(roots, box, where)), (_WINDOW, _WINDOW))
        beyond = np.maximum(np.maximum(box.x0 - columns, columns - box.x1), 0.0)
        away = 0.5 * np.square(beyond / (_OUTSIDE * max(1, box.width))).astype(np.float32)
        scores.insert(0, colour - away[None] + np.float32(_OUTLINE) * np.log(open_share * cover))
        open_share = open_share * (1.0 - cover)
    best = np.stack(scores)
    best = np.exp(_DECIDED * (best - best.max(axis=0)))
    return np.asarray(best / best.sum(axis=0), np.float32)
