"""What may be learned from pictures of a camera that stands still."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from nlens_video.frames import Bool, Float32
from nlens_video.stages.f_pool import LUMA, is_still, moving


def still_run(pictures: Sequence[Float32]) -> tuple[list[Float32], Bool]:
    """The pictures at the beginning of a shot that show the same, and where they do.

    Args:
        pictures: display-coded sRGB in [0, 1], each (H, W, 3), at least one.

    Returns:
        The first of them up to where the camera moves, and the pixels on which nothing moves in
        any of those (H, W).
    """
    first = np.asarray(pictures[0] @ LUMA, np.float32)
    window = np.asarray(cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F), np.float32)
    kept, same = [pictures[0]], np.ones(first.shape, np.bool_)
    for picture in pictures[1:]:
        luma = np.asarray(picture @ LUMA, np.float32)
        if not is_still(first, luma, window):
            break
        same &= ~moving(first, luma)
        kept.append(picture)
    return kept, same
