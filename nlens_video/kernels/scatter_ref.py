"""Layered scatter, slow and obvious: it defines what `scatter` must give."""

from __future__ import annotations

import numpy as np

from nlens_video.frames import Float32
from nlens_video.kernels.disc import coverage, fitted_radius
from nlens_video.kernels.extend import prepare


def scatter_ref(rgba: Float32, coc_px: Float32, *, pixel_aspect: float = 1.0) -> Float32:
    """Blur an object's layer by its own CoC; arguments, result and errors as `scatter.scatter`."""
    out = np.zeros(rgba.shape, dtype=np.float32)
    layer = prepare(rgba, coc_px, pixel_aspect)
    if layer is None:
        return out
    height, width = layer.radius_px.shape
    margin = int(np.ceil(layer.radius_px.max() * max(1.0, pixel_aspect))) + 1
    colour = np.zeros((height + 2 * margin, width + 2 * margin, 4))
    weight = np.zeros((height + 2 * margin, width + 2 * margin))
    for y, x in np.argwhere(layer.radius_px >= 0.0):
        radius = float(layer.radius_px[y, x])
        disc = coverage(fitted_radius(radius), fitted_radius(radius * pixel_aspect))
        up, left = disc.shape[0] // 2, disc.shape[1] // 2
        dy = np.arange(-up, up + 1)[:, None] * layer.skew[y, x, 1]
        dx = np.arange(-left, left + 1)[None, :] * layer.skew[y, x, 0]
        disc *= 1.0 + dx + dy
        spot = (
            slice(y + margin - up, y + margin + up + 1),
            slice(x + margin - left, x + margin + left + 1),
        )
        colour[spot] += disc[..., None] * layer.rgba[y, x]
        weight[spot] += disc
    kept = np.s_[margin : margin + height, margin : margin + width]
    blurred = colour[kept] / np.maximum(weight[kept], 1e-30)[..., None]
    blurred[..., 3] = np.clip(blurred[..., 3], 0.0, 1.0)
    target = layer.target
    out[target.y0 : target.y1, target.x0 : target.x1] = blurred[target.slices_in(layer.box)]
    return out
