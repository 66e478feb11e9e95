"""F on several frames: while the camera stands still, their mean shows the blur under less noise.

Noise is what a small or a smooth blur drowns in. Frames are averaged only while the picture as a
whole has not moved, and where a part of it moves, that part keeps the first frame's own samples:
a mean over motion would look like defocus.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Float32

STILL_PX = 0.25  # a mean over a larger shift would soften the picture measurably
_WINDOW_PX = 7  # noise averages out over it, motion does not
_NOISES = 5.0  # a change of the window's mean beyond so many deviations is no noise
_LEAST_CHANGE = 1.5 / 255  # nor is a smaller change than this motion [sRGB code]
QUIET = 1.2 / 255  # less noise than that costs the estimate nothing [sRGB code]
LUMA = np.array([0.3, 0.6, 0.1], np.float32)
"""Weights of red, green and blue in a picture's brightness."""


def temporal_mean(first: Float32, following: Iterable[Float32]) -> tuple[Float32, int]:
    """The mean of a picture and those after it that show the same.

    Args:
        first: display-coded sRGB in [0, 1] (H, W, 3).
        following: later pictures of the same size, in order; none is read after the camera moved,
            nor after the first where that shows hardly any noise.

    Returns:
        The mean (H, W, 3), and how many pictures are in it (1: the first alone).
    """
    luma = np.asarray(first @ LUMA, dtype=np.float32)
    window = border_window(luma)
    total, count = first.astype(np.float32), np.ones(luma.shape, np.float32)
    used = 1
    for picture in following:
        other = np.asarray(picture @ LUMA, dtype=np.float32)
        if (used == 1 and _noise(luma, other) < QUIET) or not is_still(luma, other, window):
            break
        same = (~moving(luma, other)).astype(np.uint8)
        cv2.accumulate(picture, total, mask=same)
        count += same
        used += 1
    return total / count[..., None], used


def _noise(luma: Float32, other: Float32) -> float:
    """Deviation of the noise in each of two pictures of the same scene [sRGB code]."""
    return 1.4826 * float(np.median(np.abs(other - luma)[::2, ::2])) / math.sqrt(2.0)


def border_window(luma: Float32) -> Float32:
    """Weights that hide a picture's borders (H, W); even ones for one that is nothing else."""
    if min(luma.shape) < 2:
        return np.ones_like(luma)
    return np.asarray(cv2.createHanningWindow(luma.shape[::-1], cv2.CV_32F), np.float32)


def is_still(luma: Float32, other: Float32, window: Float32) -> bool:
    """Whether the picture as a whole is where it was.

    Args:
        luma: brightness of the first (H, W).
        other: of the second (H, W).
        window: weights that hide the borders (H, W).
    """
    if min(luma.shape) < 2 * _WINDOW_PX:
        return False
    # with a window of its own phaseCorrelate writes into both pictures
    (across, down), _ = cv2.phaseCorrelate(luma * window, other * window)
    return math.hypot(across, down) <= STILL_PX


def moving(luma: Float32, other: Float32) -> Bool:
    """Where something moves, its surroundings included (H, W).

    Args:
        luma: brightness of the first picture (H, W).
        other: of the second (H, W).
    """
    change = cv2.blur(other - luma, (_WINDOW_PX, _WINDOW_PX), borderType=cv2.BORDER_REFLECT)
    some = change[::3, ::3]
    whole = np.median(some)  # a change of the light as a whole is no motion
    noise = 1.4826 * float(np.median(np.abs(some - whole)))
    change = change - whole
    moved = np.abs(change) > max(_NOISES * noise, _LEAST_CHANGE)
    around = np.ones((2 * _WINDOW_PX + 1, 2 * _WINDOW_PX + 1), np.uint8)
    return np.asarray(cv2.dilate(moved.astype(np.uint8), around) > 0)
