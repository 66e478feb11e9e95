"""Appearance model of a target: colour histograms by height, and a mean silhouette."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32

_BINS = 10  # histogram bins for each channel
_MAX_ROOT = 1.25  # square root of light at the end of the last bin [1]
_BANDS = 4  # bands of a target's height with a histogram each: head, trunk, legs, feet
_OUTLIER_SHARE = 0.02  # fraction of a target's pixels that may have any colour [1]
_OUTSIDE_SIGMA = 0.2  # how far a target reaches beyond its predicted box, by the box' width [1]
_SILHOUETTE_WEIGHT = 0.1  # of the log-likelihood of the silhouette, by that of colour [1]
_INDEPENDENT_PIXELS = 8.0  # independent observations in a window of pixels
_WINDOW_PX = 5  # side of the window whose pixels are classified together [lowres px]
_SILHOUETTE_SIDE = 64  # rows and columns of a silhouette
_SILHOUETTE_WIDTH = 1.2  # width of a silhouette, by the larger side of the target's box [1]
_MIN_COVERAGE = 0.03  # probability that a target covers a pixel far outside its silhouette [1]


@dataclass(slots=True)
class AppearanceModel:
    """Colours and silhouette of a target, learnt from frames on which it is isolated.

    Attributes:
        histogram: pixels by band of height and by the roots of light of red, green and blue.
        silhouette: sum of the target's masks (_SILHOUETTE_SIDE, _SILHOUETTE_SIDE) [1]; rows span
            the height of its box, columns are centred on its torso.
        samples: number of frames that were learnt from [1].
    """

    histogram: Float32 = field(
        default_factory=lambda: np.zeros((_BANDS, _BINS, _BINS, _BINS), np.float32)
    )
    silhouette: Float32 = field(
        default_factory=lambda: np.zeros((_SILHOUETTE_SIDE, _SILHOUETTE_SIDE), np.float32)
    )
    samples: int = 0

    def update(self, roots: Float32, mask: Bool, box: Box, *, weight: int = 1) -> None:
        """Learn from a frame.

        Args:
            roots: square root of its light (h, w, 3).
            mask: its foreground mask (h, w).
            box: of the target, inside the frame.
            weight: 1; or -1 to remove a frame that was learnt from.
        """
        crop = box.slices_in(Box(0, 0, *mask.shape[::-1]))
        inner = cv2.erode(mask[crop].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        bins = _bin_indices(roots[crop], box, box)[inner]
        counts = np.bincount(bins, minlength=self.histogram.size).reshape(self.histogram.shape)
        self.histogram += weight * counts.astype(np.float32)
        rows, columns = np.meshgrid(*_silhouette_grid(box, torso_column(mask, box)), indexing="ij")
        silhouette = cv2.remap(
            mask[crop].astype(np.float32), (columns - box.x0).astype(np.float32),
            (rows - box.y0).astype(np.float32), cv2.INTER_LINEAR, borderValue=0.0,
        )  # fmt: skip
        self.samples += weight
        self.silhouette += weight * silhouette

    def colour_likelihood(self, roots: Float32, box: Box, window: Box) -> Float32:
        """Likelihood of the colour of each pixel of a window, if it shows the target (h, w) [1].

        Args:
            roots: square root of the light of the window (h, w, 3).
            box: of the target.
            window: part of the frame.
        """
        smooth = self.histogram
        for axis in (1, 2, 3):
            padded = np.pad(smooth, [(int(axis == one),) * 2 for one in range(4)], mode="edge")
            low, high = (np.take(padded, np.arange(_BINS) + off, axis) for off in (0, 2))
            smooth = 0.25 * low + 0.5 * smooth + 0.25 * high
        total = np.maximum(smooth.sum(axis=(1, 2, 3), keepdims=True), np.float32(1.0))
        shares = (1.0 - _OUTLIER_SHARE) * smooth / total + _OUTLIER_SHARE / _BINS**3
        return np.asarray(shares.ravel()[_bin_indices(roots, box, window)], np.float32)

    def coverage(self, box: Box, window: Box) -> Float32:
        """Probability that the target covers each pixel of a window, by its silhouette (h, w) [1].

        Args:
            box: of the target, centred on its torso.
            window: part of the frame.
        """
        rows, columns = _silhouette_grid(box, 0.5 * (box.x0 + box.x1 - 1))
        y = (np.arange(window.y0, window.y1) - rows[0]) / (rows[1] - rows[0])
        x = (np.arange(window.x0, window.x1) - columns[0]) / (columns[1] - columns[0])
        across, down = np.meshgrid(x.astype(np.float32), y.astype(np.float32))
        found = cv2.remap(self.silhouette, across, down, cv2.INTER_LINEAR, borderValue=0.0)
        found = found / np.float32(max(1, self.samples))
        return np.asarray(np.clip(found, _MIN_COVERAGE, 1.0 - _MIN_COVERAGE), np.float32)


def torso_column(mask: Bool, box: Box) -> float:
    """Mean column of the upper half of a target [px]; swinging legs do not move it."""
    crop = box.slices_in(Box(0, 0, *mask.shape[::-1]))
    part = mask[crop][: max(1, box.height // 2)]
    columns = np.flatnonzero(part.any(axis=0))
    if not columns.size:
        return 0.5 * (box.x0 + box.x1 - 1)
    weights = part.sum(axis=0)[columns]
    return box.x0 + float((columns * weights).sum() / weights.sum())


def _silhouette_grid(box: Box, column: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the frame at which the silhouette is sampled [px]."""
    side = _SILHOUETTE_WIDTH * max(box.width, box.height, 2)
    steps = np.arange(_SILHOUETTE_SIDE) + 0.5
    rows = box.y0 + steps * (max(box.height, 2) / _SILHOUETTE_SIDE) - 0.5
    return rows, column + (steps / _SILHOUETTE_SIDE - 0.5) * side


def _bin_indices(roots: Float32, box: Box, window: Box) -> np.ndarray:
    """Index into the histogram for each pixel of a window (h, w)."""
    rows = np.arange(window.y0, window.y1) + 0.5 - box.y0
    bands = np.clip(rows * (_BANDS / max(1, box.height)), 0, _BANDS - 1).astype(np.int64)
    codes = np.clip(roots * (_BINS / _MAX_ROOT), 0, _BINS - 1).astype(np.int64)
    colours = (codes[..., 0] * _BINS + codes[..., 1]) * _BINS + codes[..., 2]
    return np.asarray(bands[:, None] * _BINS**3 + colours)


def segment(
    appearances: list[AppearanceModel], boxes: list[Box], roots: Float32, window: Box
) -> Float32:
    """Probability that a pixel of a merged blob shows each target (n, h, w); sums to 1.

    Args:
        appearances: of the targets, the farthest first.
        boxes: predicted boxes of the targets, each centred on the torso.
        roots: square root of the light of a window (h, w, 3).
        window: part of the frame.
    """
    columns = np.arange(window.x0, window.x1) + 0.5
    scores: list[Float32] = []
    visible = np.ones(roots.shape[:2], np.float32)  # probability that no nearer target covers it
    for appearance, box in zip(reversed(appearances), reversed(boxes), strict=True):
        cover = appearance.coverage(box, window)
        likelihood = appearance.colour_likelihood(roots, box, window)
        colour = cv2.blur(np.log(likelihood), (_WINDOW_PX, _WINDOW_PX))
        outside = np.maximum(np.maximum(box.x0 - columns, columns - box.x1), 0.0)
        sigma = _OUTSIDE_SIGMA * max(1, box.width)
        penalty = 0.5 * np.square(outside / sigma).astype(np.float32)
        silhouette = np.float32(_SILHOUETTE_WEIGHT) * np.log(visible * cover)
        scores.insert(0, colour - penalty[None] + silhouette)
        visible = visible * (1.0 - cover)
    best = np.stack(scores)
    best = np.exp(_INDEPENDENT_PIXELS * (best - best.max(axis=0)))
    return np.asarray(best / best.sum(axis=0), np.float32)
