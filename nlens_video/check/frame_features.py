"""What the check keeps of a frame: its luma, and its colour and detail by blocks."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import cv2
import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.video.info import SourceFrame

BLOCK_PX = 8
"""Edge of a block; those of common codecs, so that their noise averages out inside one [px]."""
_BAND_PX = (1.0, 4.0)  # finer than that an encoder's noise drowns what the lens has left
_CHROMA = ((2, 1 / 1.8556), (0, 1 / 1.5748))  # of B - Y and R - Y, as BT.709 scales them
_LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class FrameFeatures:
    """One frame, as far as the check looks at it.

    Attributes:
        index: position in its source.
        time_s: since the source's first frame, exact [s].
        luma: display-coded, 0 to 255, (H, W) [level].
        colour: mean luma and both colour differences of each block, (h, w, 3) [level].
        detail: mean of each block's absolute band-pass of the luma, (h, w) [level].
    """

    index: int
    time_s: Fraction
    luma: Float32
    colour: Float32
    detail: Float32


def frame_features(frame: SourceFrame, first_pts: int) -> FrameFeatures:
    """Measure one frame; `first_pts` is that of the source's first [ticks]."""
    rgb = np.float32(255.0) * frame.picture.srgb()
    luma: Float32 = np.ascontiguousarray(rgb @ _LUMA, np.float32)
    fine, coarse = (cv2.GaussianBlur(luma, (0, 0), sigma) for sigma in _BAND_PX)
    return FrameFeatures(
        index=frame.index,
        time_s=(frame.pts - first_pts) * frame.time_base,
        luma=luma,
        colour=block_mean(
            np.dstack([luma, *(scale * (rgb[..., at] - luma) for at, scale in _CHROMA)])
        ),
        detail=block_mean(np.abs(fine - coarse)),
    )


def block_mean(values: Float32) -> Float32:
    """Mean of each whole block of (H, W) or (H, W, channels); a frame below one block is one."""
    height, width = values.shape[:2]
    rows, columns = max(1, height // BLOCK_PX), max(1, width // BLOCK_PX)
    whole = values[: min(height, rows * BLOCK_PX), : min(width, columns * BLOCK_PX)]
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)
