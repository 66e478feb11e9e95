"""The object cut in two at its steps where it is known what its nearest surfaces hide.

Nothing is carried on and nothing parted by guess, as `depth_layers` must.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from nlens_video.core.layers import Bool, Float32
from nlens_video.kernels.reblur.coc_discontinuities import Hidden, Steps
from nlens_video.kernels.reblur.depth_layers import DepthLayers


def split_before(rgba: Float32, coc_px: Float32, steps: Steps, hidden: Hidden) -> DepthLayers:
    """Cut the object in two where it is known what is hidden: nothing is guessed.

    Args:
        rgba: premultiplied scene-linear colour and alpha (h, w, 4).
        coc_px: signed CoC diameter (h, w), positive nearer than focus, read only where alpha > 0.
        steps: where it steps.
        hidden: what the nearest surfaces hide.
    """
    near = (rgba[..., 3] > 0.0) & (coc_px > steps.split_px)
    near_rgba = np.zeros_like(rgba)
    back_rgba, back_coc = rgba.copy(), coc_px.copy()
    _part(near, (rgba, hidden.front_rgba), hidden.rgba, near_rgba, back_rgba)
    np.copyto(back_coc, hidden.coc_px, where=near)
    return DepthLayers(
        near_rgba=near_rgba,
        near_coc_px=np.where(near, coc_px, np.float32(0.0)),
        back_rgba=back_rgba,
        back_coc_px=back_coc,
    )


@njit(cache=True, nogil=True)
def _part(
    near: Bool, front: tuple[Float32, Float32], hidden: Float32,
    near_rgba: Float32, back_rgba: Float32,
) -> None:  # fmt: skip
    """Fill in the near layer's colours and those that it hides.

    Its antialiased pixels are those beside what is not near; only they are parted, for on a steep
    surface samples of one pixel lie apart too.
    """
    whole, alone = front
    for y in range(near.shape[0]):
        for x in range(near.shape[1]):
            if near[y, x]:
                source = alone if _at_rim(near, y, x) else whole
                for c in range(4):
                    near_rgba[y, x, c] = source[y, x, c]
                    back_rgba[y, x, c] = hidden[y, x, c]


@njit(cache=True, nogil=True)
def _at_rim(mask: Bool, y: int, x: int) -> bool:
    """Whether one of the eight neighbours is not in the mask."""
    for j in range(max(0, y - 1), min(mask.shape[0], y + 2)):
        for i in range(max(0, x - 1), min(mask.shape[1], x + 2)):
            if not mask[j, i]:
                return True
    return False
