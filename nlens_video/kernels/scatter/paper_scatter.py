"""The classical renderer of the paper's reblur: every pixel scatters, nothing hides anything.

After BokehMe (Peng et al. 2022), which the paper adopts: a pixel of radius r gives the pixel at
distance d the weight (0.5 + 0.5 tanh(4 (r - d))) / (r^2 + 0.2), and the sum is divided by all
weights that arrive. It is kept as they state it, faults included: it is what the paper's method
costs and gives. `scatter` is what the other presets use.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.thread_pool import bands, parallel_for
from nlens_video.native import kernels

BAND_ROWS = 16
"""Rows of the result that a thread takes at a time."""


def _rim() -> Float32:
    """0.5 + 0.5 tanh(4 t) for t from -RIM_PX to RIM_PX in steps of 1 / RIM_STEPS."""
    steps, most = kernels.RIM_STEPS, kernels.RIM_PX
    t = np.arange(int(2 * most * steps) + 1) / steps - most
    return np.asarray(0.5 + 0.5 * np.tanh(4.0 * t), dtype=np.float32)


def paper_scatter(
    light: Float32, radius_px: Float32, *, threads: int | None = None
) -> tuple[Float32, Float32]:
    """Scatter a whole picture by its radii.

    Args:
        light: scene-linear RGB (h, w, 3).
        radius_px: radius of each pixel's disc (h, w), >= 0 [px].
        threads: how many threads share the rows at most; default: one a processor. The result
            does not depend on it.

    Returns:
        The blurred picture (h, w, 3), and the largest radius whose disc covers each pixel (h, w).

    Raises:
        ValueError: shapes that do not belong together, radii that are negative or not finite.
    """
    if light.shape != (*radius_px.shape, 3):
        raise ValueError(f"{light.shape = } must be (h, w, 3) and {radius_px.shape = } its (h, w)")
    if not (np.isfinite(radius_px).all() and (radius_px >= 0.0).all()):
        raise ValueError("radii must be finite and not negative")
    light = np.ascontiguousarray(light, dtype=np.float32)
    radius_px = np.ascontiguousarray(radius_px, dtype=np.float32)
    out, dilated = np.zeros_like(light), np.zeros_like(radius_px)
    work = partial(kernels.paper_scatter_rows, light, radius_px, _rim(), out, dilated)
    parallel_for(work, bands(light.shape[0], BAND_ROWS), threads)
    return out, dilated
