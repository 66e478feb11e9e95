"""Bloom of the object: halos round those of its highlights that the plate could not hold.

The plate's halo is known against white only: how bright its lamps are nobody can see. So a
highlight of the object counts from white upwards and no further than to twice white, where its halo
is that of the plate's lamps.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32
from nlens_video.core.lens_models import Bloom

WHITE = 1.0
_REACH_LENGTHS = 6.0  # where the density has fallen to a four hundredth
_MARGIN_LIMIT_PX = 256
_COARSE_LENGTH = 4.0  # decay length on the grid that the quick halo is made on [px]


def bloomed(layer: BlurredLayer, bloom: Bloom, frame: Box) -> BlurredLayer:
    """A layer with the halos of its highlights; itself where nothing of it is above white.

    Args:
        layer: premultiplied, inside the frame.
        bloom: of the lens.
        frame: the frame's own box, which bounds the halos.
    """
    if layer.box.empty or float(layer.rgba[..., :3].max()) <= WHITE:
        return layer
    margin = math.ceil(min(_REACH_LENGTHS * bloom.length_px, _MARGIN_LIMIT_PX))
    wide = layer.box.expanded(margin)
    box = wide.intersection(frame)
    excess = np.clip(layer.rgba[..., :3] - np.float32(WHITE), 0.0, np.float32(WHITE))
    around = np.pad(excess, ((margin, margin), (margin, margin), (0, 0)))
    halo = quick_halo(around, bloom.length_px)[box.slices_in(wide)]
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    rgba[layer.box.slices_in(box)] = layer.rgba
    rgba[..., :3] += np.float32(bloom.share) * halo
    return BlurredLayer(box=box, rgba=rgba)


def halo_of(light: Float32, length_px: float) -> Float32:
    """Light (h, w) or (h, w, C) spread with a density that falls exponentially: the plain way.

    Args:
        light: what is spread.
        length_px: distance over which the density falls to 1 / e [px].
    """
    reach = math.ceil(7.0 * length_px)
    away = np.hypot(*np.meshgrid(*2 * [np.arange(-reach, reach + 1, dtype=np.float32)]))
    kernel = np.exp(-away / np.float32(length_px))
    border = cv2.BORDER_CONSTANT
    return np.asarray(cv2.filter2D(light, cv2.CV_32F, kernel / kernel.sum(), borderType=border))


def quick_halo(light: Float32, length_px: float) -> Float32:
    """The same on a grid as coarse as the halo allows."""
    step = max(1, int(length_px / _COARSE_LENGTH))
    if step == 1:
        return halo_of(light, length_px)
    height, width = light.shape[:2]
    padded = np.pad(light, ((0, -height % step), (0, -width % step), (0, 0)))
    rows, columns = padded.shape[0] // step, padded.shape[1] // step
    small = cv2.resize(padded, (columns, rows), interpolation=cv2.INTER_AREA)
    halo = halo_of(np.asarray(small, np.float32), length_px / step)
    size = (columns * step, rows * step)
    return np.asarray(cv2.resize(halo, size, interpolation=cv2.INTER_CUBIC)[:height, :width])
