"""Line segments of a picture, at several scales: defocused edges show in reduced pictures.

Segments that lie on one line are joined, for a long line tells its vanishing point best: the rows
of a chequered floor, which change side at each tile, become lines across the floor.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Bool, Float64
from nlens_video.solve.still.joining import join_segments

_SCALES = (1, 2, 4)
_SHORTEST = 0.012  # of the frame's diagonal, at full size
_LONGER = 0.5  # by how much longer a segment must be for each further scale [1]
_MOST = 900  # that are looked at
_BINS, _MOST_PER_BIN = 18, 60  # one direction, such as the grain of wood, must not stand for all
_PARALLEL = 0.06  # sine of the angle between segments of one edge
_SAME_PX = 1.0
_ALONG = 0.01
_BORDER, _EVEN = 0.008, 6.0  # of the frame's width or height; deviation along it [8-bit]
_ERROR_PX, _BLURRED = 0.35, 0.8  # of an end, and its growth with the scale; from known cameras


class Segments(Struct, frozen=True, eq=False):
    """Line segments, longest first.

    Attributes:
        ends: first and second end (N, 2, 2), pixel centres at +0.5 [px].
        error_px: standard error of an end across the segment (N,) [px].
    """

    ends: Float64
    error_px: Float64

    @property
    def lengths(self) -> Float64:
        """Lengths (N,) [px]."""
        return np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1))

    def along(self, other: Float64, width: int) -> Bool:
        """Which of them lie along another segment (N,).

        Args:
            other: its ends (2, 2) [px].
            width: of the frame; both ends of a segment along another are no farther from that than
                a hundredth of it [px].
        """
        first, last = other
        way = last - first
        share = (self.ends - first) @ way / max(float(way @ way), 1e-9)
        nearest = first + np.clip(share, 0.0, 1.0)[..., None] * way
        apart = np.linalg.norm(self.ends - nearest, axis=2)
        return np.asarray((apart <= _ALONG * width).all(axis=1))

    def without(self, others: Float64, width: int) -> Segments:
        """Those that do not lie along one of some other segments.

        Args:
            others: their ends (M, 2, 2) [px].
            width: as of `along` [px].
        """
        kept = np.ones(len(self.ends), bool)
        for other in others:
            kept &= ~self.along(other, width)
        return Segments(self.ends[kept], self.error_px[kept])


NO_SEGMENTS = Segments(np.zeros((0, 2, 2)), np.zeros(0))
"""Of a picture that shows none."""


def find_segments(luma: npt.NDArray[np.uint8]) -> Segments:
    """Segments by LSD at three scales, each edge once, joined along lines.

    Args:
        luma: picture (H, W).
    """
    height, width = luma.shape
    shortest = _SHORTEST * np.hypot(width, height)
    detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_ADV)
    ends, scales = [], []
    for level, scale in enumerate(_SCALES):
        if min(height, width) < 16 * scale:
            break
        size = width // scale, height // scale
        reduced = luma if scale == 1 else cv2.resize(luma, size, interpolation=cv2.INTER_AREA)
        found = detector.detect(reduced)[0]
        if found is None:
            continue
        lines = (found.reshape(-1, 2, 2).astype(np.float64) + 0.5) * (
            width / size[0],
            height / size[1],
        )
        long = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1) > shortest * (1 + _LONGER * level)
        kept = long & ~_on_margin(lines, luma, float(scale))
        ends.append(lines[kept])
        scales.append(np.full(int(kept.sum()), float(scale)))
    if not ends:
        return NO_SEGMENTS
    return _joined(np.concatenate(ends), np.concatenate(scales))


def _on_margin(ends: Float64, luma: npt.NDArray[np.uint8], scale: float) -> Bool:
    """Which segments (N, 2, 2) lie along an even margin of the frame, as a scan's."""
    first = np.array([luma[:, 0].std(), luma[0].std()]) < _EVEN
    last = np.array([luma[:, -1].std(), luma[-1].std()]) < _EVEN
    whole = np.array(luma.shape[::-1], np.float64)
    margin = _BORDER * whole + 0.75 * scale
    lower, upper = (ends < margin).all(axis=1), (ends > whole - margin).all(axis=1)
    return np.asarray(np.any((lower & first) | (upper & last), axis=1))


def _joined(ends: Float64, scales: Float64) -> Segments:
    """Each edge once, joined along lines; ends (N, 2, 2) [px] and the scales that they show at."""
    kept = _once(ends, scales, _MOST)
    return _balanced(*join_segments(ends[kept], _ERROR_PX * scales[kept] ** _BLURRED))


def pooled(parts: Sequence[Segments], most: int) -> Segments:
    """The longest segments of several pictures of one scene, each edge once.

    Args:
        parts: of the pictures, in the axes of one of them.
        most: so many are kept.
    """
    ends = np.concatenate([one.ends for one in parts])
    errors = np.concatenate([one.error_px for one in parts])
    kept = _once(ends, (errors / _ERROR_PX) ** (1.0 / _BLURRED), most)
    return Segments(ends[kept], errors[kept])


def _once(ends: Float64, scales: Float64, most: int) -> list[int]:
    """Which segments (N, 2, 2) do not lie along a longer one, longest first, at most so many."""
    vectors = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(vectors, axis=1)
    order = np.argsort(-lengths, kind="stable")
    ends, scales, lengths = ends[order], scales[order], lengths[order]
    along = vectors[order] / np.maximum(lengths, 1e-9)[:, None]
    middles = ends.mean(axis=1)
    kept: list[int] = []
    for n in range(len(ends)):
        if len(kept) == most:
            break
        other = along[kept]
        offset = middles[n] - ends[kept, 0]
        turned = abs(other[:, 0] * along[n, 1] - other[:, 1] * along[n, 0])
        apart = abs(offset[:, 0] * other[:, 1] - offset[:, 1] * other[:, 0])
        at = (offset * other).sum(axis=1)
        overlap = np.minimum(at + lengths[n] / 2, lengths[kept]) - np.maximum(
            at - lengths[n] / 2, 0
        )
        same = (turned < _PARALLEL) & (overlap > 0.5 * lengths[n])
        same &= apart < _SAME_PX + 1.5 * np.maximum(scales[n], scales[kept])
        if not same.any():
            kept.append(n)
    return [int(one) for one in order[kept]]


def _balanced(ends: Float64, error_px: Float64) -> Segments:
    """Longest first, with at most so many of one direction in the picture."""
    vectors = ends[:, 1] - ends[:, 0]
    order = np.argsort(-np.linalg.norm(vectors, axis=1), kind="stable")
    angle = np.arctan2(vectors[order, 1], vectors[order, 0]) % np.pi
    bins = np.minimum(angle * (_BINS / np.pi), _BINS - 1).astype(int)
    kept = [n for one in range(_BINS) for n in np.flatnonzero(bins == one)[:_MOST_PER_BIN]]
    chosen = order[np.sort(np.array(kept, int))]
    return Segments(ends[chosen], error_px[chosen])
