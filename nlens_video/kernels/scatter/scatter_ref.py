"""Layered scatter, slow and obvious: it defines what `scatter` must give."""

from __future__ import annotations

import numpy as np

from nlens_video.core.aperture import ROUND, Aperture
from nlens_video.core.layers import Box, Float32
from nlens_video.kernels.scatter.extend_ref import prepare
from nlens_video.kernels.scatter.shape import barrel_centre
from nlens_video.kernels.scatter.tables import coverage


def scatter_ref(
    rgba: Float32,
    coc_px: Float32,
    *,
    pixel_aspect: float = 1.0,
    aperture: Aperture = ROUND,
    frame: Box | None = None,
) -> Float32:
    """Blur an object's layer by its own CoC; arguments, result and errors as `scatter.scatter`."""
    out = np.zeros(rgba.shape, dtype=np.float32)
    layer = prepare(rgba, coc_px, pixel_aspect, aperture)
    if layer is None:
        return out
    frame = Box(0, 0, rgba.shape[1], rgba.shape[0]) if frame is None else frame
    middle = layer.box.x0 - frame.x0 + 0.5, layer.box.y0 - frame.y0 + 0.5
    height, width = layer.radius_px.shape
    margin = layer.margin + 1
    colour = np.zeros((height + 2 * margin, width + 2 * margin, 4))
    weight = np.zeros((height + 2 * margin, width + 2 * margin))
    for y, x in np.argwhere(np.isfinite(layer.radius_px)):
        radius = float(layer.radius_px[y, x])
        barrel = barrel_centre(
            aperture,
            np.array((x + middle[0]) * pixel_aspect),
            np.array(y + middle[1]),
            (frame.width * pixel_aspect, frame.height),
        )
        disc = coverage(aperture, abs(radius), pixel_aspect, (float(barrel[0]), float(barrel[1])))
        if radius > 0.0:
            disc = disc[::-1, ::-1]
        up, left = disc.shape[0] // 2, disc.shape[1] // 2
        dy = np.arange(-up, up + 1)[:, None] * layer.skew[y, x, 1]
        dx = np.arange(-left, left + 1)[None, :] * layer.skew[y, x, 0]
        disc = disc * (1.0 + dx + dy)
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
