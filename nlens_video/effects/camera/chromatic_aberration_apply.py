"""Lateral chromatic aberration of the object: red and blue displaced along the radius.

Each channel has a silhouette of its own then, which one alpha cannot say. What red and blue cover
more or less than green is said with the plate's own light, so that an edge fringes over the plate
as the plate's edges do.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32, Picture
from nlens_video.core.lens_models import Aberration
from nlens_video.core.radial import from_middle, half_diagonal, square_radius


def displace_channels(
    layer: BlurredLayer, aberration: Aberration, picture: Picture, frame: Box
) -> BlurredLayer:
    """A layer as a lens draws it that does not bring all colours to the same place.

    Args:
        layer: premultiplied, inside the frame.
        aberration: of the lens.
        picture: the plate that the layer is laid over; left as it is.
        frame: the frame's own box.

    Returns:
        A layer that gives the fringed object when it is laid over this very plate.
    """
    if layer.box.empty:
        return layer
    margin = math.ceil(_most(aberration))
    wide = layer.box.expanded(margin)
    box = wide.intersection(frame)
    source = _grown(layer, margin, frame)
    out = np.ascontiguousarray(source[box.slices_in(wide)])
    alpha = out[..., 3].copy()
    plate = picture.linear(box)
    for channel, (linear, cubic) in ((0, aberration.red), (2, aberration.blue)):
        if not (linear or cubic):
            continue
        pair = np.ascontiguousarray(source[..., (channel, 3)])
        moved = _moved(pair, wide, box, frame, (linear, cubic))
        light, cover = np.maximum(moved[..., 0], 0.0), np.clip(moved[..., 1], 0.0, 1.0)
        out[..., channel] = light + (alpha - cover) * plate[..., channel]
    return BlurredLayer(box=box, rgba=out)


def _most(aberration: Aberration) -> float:
    """Largest displacement anywhere on the frame [px]."""
    r = np.linspace(0.0, 1.0, 65)
    both = (aberration.red, aberration.blue)
    return max(float(np.abs(linear * r + cubic * r**3).max()) for linear, cubic in both)


def _grown(layer: BlurredLayer, margin: int, frame: Box) -> Float32:
    """The layer with a margin; a picture that the frame cuts goes on beyond it."""
    held = layer.box
    sides = [(margin, held.y0 == frame.y0, held.y1 == frame.y1),
             (margin, held.x0 == frame.x0, held.x1 == frame.x1)]  # fmt: skip
    grown = layer.rgba
    for axis, (width, before, after) in enumerate(sides):
        for at, cut in ((0, before), (1, after)):
            pad = [(0, 0), (0, 0), (0, 0)]
            pad[axis] = (width, 0) if at == 0 else (0, width)
            grown = np.pad(grown, pad, mode="edge" if cut else "constant")
    return grown


def _moved(pair: Float32, wide: Box, box: Box, frame: Box, parts: tuple[float, float]) -> Float32:
    """Light and coverage of a channel on a box, from where the lens takes them."""
    half = half_diagonal(frame)
    columns, rows = from_middle(box, frame)
    square = square_radius(box, frame)
    # what lands at r comes from r - d(r) to first order; d changes by a thousandth of a pixel
    scale = np.float32(1.0) - (np.float32(parts[0]) + np.float32(parts[1]) * square) / np.float32(
        half
    )
    middle_x, middle_y = 0.5 * (frame.x0 + frame.x1), 0.5 * (frame.y0 + frame.y1)
    x = columns[None, :] * scale + np.float32(middle_x - wide.x0 - 0.5)
    y = rows[:, None] * scale + np.float32(middle_y - wide.y0 - 0.5)
    return np.asarray(cv2.remap(pair, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))
