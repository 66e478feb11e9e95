"""What may be learned from pictures of a camera that stands still."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Picture
from nlens_video.effects.camera.grain_kernels import to_code
from nlens_video.stages.f_coc import LUMA, border_window, is_still, moving

_MOST_COLUMNS, _MOST_ROWS = 1280, 720


def middle_codes(picture: Picture) -> Float32:
    """Display-coded sRGB of a picture, of its middle where it is large (H, W, 3).

    Noise and sharpness must be seen at full size, but need not be seen everywhere.
    """
    width, height = min(picture.width, _MOST_COLUMNS), min(picture.height, _MOST_ROWS)
    if (width, height) == (picture.width, picture.height):
        return picture.srgb()
    left, top = (picture.width - width) // 2, (picture.height - height) // 2
    linear = picture.linear(Box(left, top, left + width, top + height))
    return to_code(np.clip(linear, 0.0, 1.0))


def still_run(pictures: Sequence[Float32]) -> tuple[list[Float32], Bool]:
    """The pictures at the beginning of a shot that show the same, and where they do.

    Args:
        pictures: display-coded sRGB in [0, 1], each (H, W, 3), at least one.

    Returns:
        The first of them up to where the camera moves, and the pixels on which nothing moves in
        any of those (H, W).
    """
    first = np.asarray(pictures[0] @ LUMA, np.float32)
    window = border_window(first)
    kept, same = [pictures[0]], np.ones(first.shape, np.bool_)
    for picture in pictures[1:]:
        luma = np.asarray(picture @ LUMA, np.float32)
        if not is_still(first, luma, window):
            break
        same &= ~moving(first, luma)
        kept.append(picture)
    return kept, same
