"""What moves by itself before a camera that turns: its pictures are laid over each other.

Lines of somebody who walks are upright in the frame, and would stand for the world's vertical.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.solve.still.segments import Segments

UInt8 = npt.NDArray[np.uint8]

_FEWEST = 3  # pictures that show a place
_OFF, _OFF_NOISE = 10.0, 5.0  # difference that is no noise [8-bit]; by the median one [1]
_SHIFT_PX = 0.7  # by which the pictures may lie beside each other
_SMOOTH_PX, _GROWN_PX = 5, 7
_ALONG = np.linspace(0.0, 1.0, 9)  # places along a segment
_ON = 0.4  # share of them that lie on what moves


def moving_areas(
    pictures: Mapping[int, UInt8], turns: Mapping[int, Float64], focals_px: Mapping[int, float]
) -> dict[int, Bool]:
    """Where each picture differs from the median of all, seen in its own direction (H, W).

    Args:
        pictures: by frame (H, W).
        turns: from each frame's camera axes to common ones (3, 3).
        focals_px: focal length on each frame [px].
    """
    found = {}
    for frame, own in pictures.items():
        size = own.shape[1], own.shape[0]
        layers = [own.astype(np.float32)]
        for other, picture in pictures.items():
            if other != frame:
                there, here = _lens(focals_px[other], size), _lens(focals_px[frame], size)
                matrix = here @ turns[frame].T @ turns[other] @ np.linalg.inv(there)
                layers.append(_laid_over(layers[0], picture, matrix))
        found[frame] = _differs(np.array(layers))
    return found


def beside_areas(segments: Segments, areas: Bool) -> Segments:
    """The segments that do not lie on some areas of their picture (H, W)."""
    first, last = segments.ends[:, :1], segments.ends[:, 1:]
    places = (first + (last - first) * _ALONG[:, None]).astype(np.int64)
    columns, rows = np.moveaxis(places.clip(0, np.array(areas.shape[::-1]) - 1), -1, 0)
    kept = areas[rows, columns].mean(axis=1) < _ON
    return Segments(segments.ends[kept], segments.error_px[kept])


def _lens(focal_px: float, size: tuple[int, int]) -> Float64:
    """From camera axes, glTF's, to homogeneous pixels whose centres are whole numbers (3, 3)."""
    column, row = (size[0] - 1) / 2.0, (size[1] - 1) / 2.0
    return np.array([[focal_px, 0.0, -column], [0.0, -focal_px, -row], [0.0, 0.0, -1.0]])


def _laid_over(own: Float32, picture: UInt8, matrix: Float64) -> Float32:
    """A picture seen in another's direction, as bright as that (H, W); nan beyond its border."""
    size = own.shape[1], own.shape[0]
    laid = cv2.warpPerspective(
        picture.astype(np.float32), matrix, size, borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )  # fmt: skip
    both = laid > 1.0
    gain = float(np.median(own[both] / laid[both])) if both.any() else 1.0
    return np.asarray(laid * np.float32(gain))


def _differs(layers: Float32) -> Bool:
    """Where the first of some pictures (N, H, W) shows something else than most (H, W)."""
    shown = np.isfinite(layers).sum(axis=0)
    most = np.nanmedian(layers, axis=0).astype(np.float32)
    off = abs(layers[0] - most)
    slope = cv2.magnitude(
        cv2.Sobel(most, cv2.CV_32F, 1, 0, scale=0.125),
        cv2.Sobel(most, cv2.CV_32F, 0, 1, scale=0.125),
    )
    off = cv2.blur(np.maximum(off - _SHIFT_PX * slope, 0.0), (_SMOOTH_PX, _SMOOTH_PX))
    differs = (off > max(_OFF, _OFF_NOISE * float(np.median(off)))) & (shown >= _FEWEST)
    grown = cv2.dilate(differs.astype(np.uint8), np.ones((_GROWN_PX, _GROWN_PX), np.uint8))
    return np.asarray(grown > 0)
