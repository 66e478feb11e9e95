"""Vignetting of the object: it loses light towards the corners as the plate does."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.lens_models import Vignetting
from nlens_video.core.radial import square_radius


def vignetted(layer: BlurredLayer, vignetting: Vignetting, frame: Box) -> BlurredLayer:
    """A layer with the light that the lens leaves it; what it covers stays covered.

    Args:
        layer: premultiplied, inside the frame.
        vignetting: of the lens.
        frame: the frame's own box.
    """
    if layer.box.empty:
        return layer
    square = square_radius(layer.box, frame)
    loss = square * (np.float32(vignetting.square) + np.float32(vignetting.fourth) * square)
    rgba = layer.rgba.copy()
    rgba[..., :3] *= np.exp2(-loss)[..., None]
    return BlurredLayer(box=layer.box, rgba=rgba)
