"""Small layers to compile kernels with, or load them from the cache, before the first frame."""

from __future__ import annotations

import numpy as np

from nlens_video.core.box import Box
from nlens_video.core.layers import BlurredLayer, DefocusedLayer, HiddenLayer, ObjectLayer

_SIDE = 24
FRAME = Box(0, 0, _SIDE, _SIDE)
"""Their frame [px]."""


def sharp_layer(*, hidden: bool = False) -> DefocusedLayer:
    """A layer with a CoC discontinuity, whose discs use every method of the scatter.

    Args:
        hidden: whether it holds hidden surfaces.
    """
    rgba = np.ones((_SIDE, _SIDE, 4), np.float32)
    coc = np.repeat(np.linspace(-44.0, 0.0, _SIDE, dtype=np.float32)[:, None], _SIDE, axis=1)
    coc[:, _SIDE // 2 :] = 3.0
    layer = ObjectLayer(box=FRAME, rgba=rgba, depth=np.ones_like(coc))
    behind = (
        HiddenLayer(box=FRAME, rgba=rgba, coc_px=coc - 5.0, front_rgba=rgba) if hidden else None
    )
    return DefocusedLayer(layer=layer, coc_px=coc, behind=behind)


def blurred_layer() -> BlurredLayer:
    """A blurred layer on the same frame."""
    return BlurredLayer(box=FRAME, rgba=sharp_layer().layer.rgba)


def scatter_kernels() -> None:
    """The scatter with a round aperture."""
    from nlens_video.kernels.scatter.scatter import scatter

    sharp = sharp_layer()
    scatter(sharp.layer.rgba, sharp.coc_px)


def cell() -> None:
    """The blur of small discs."""
    from nlens_video.kernels.reblur.subaperture_gather import gather_subaperture

    sharp = sharp_layer()
    rgba = sharp.layer.rgba
    gather_subaperture(rgba, rgba[..., 3] > 0.0, np.clip(sharp.coc_px, -4.0, 4.0), FRAME)


def blend() -> None:
    """Samples to scene-linear light and back."""
    from nlens_video.video.pixels.picture import ArrayPicture

    picture = ArrayPicture(np.zeros((_SIDE, _SIDE, 3), np.uint8))
    picture.linear(FRAME)
    picture.over(FRAME, sharp_layer().layer.rgba)
