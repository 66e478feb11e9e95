"""Blur of what lies on a plane by a round lens: each pixel is the mean over its own disc.

The CoC of a plane is affine across the picture, so what a pixel sees of it through the lens is
nearly a disc as large as its own CoC; and where the layer has no outline, nothing is to
be weighted or extended. A gather then takes a quarter of the time of a scatter. A row of a
disc is a span, the difference of two running sums; these are of integers, and so exact.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.kernels.scatter.disc import fitted_radii
from nlens_video.kernels.scratch import scratch
from nlens_video.kernels.thread_pool import bands, parallel_for
from nlens_video.native import kernels

LARGEST_COC_PX = 32.0
"""Largest CoC of which this is quicker than the scatter, whose large discs are coarse [px]."""
WIDEST_PX = 1 << 15
"""Columns whose running sums fit an integer [px]."""
_STEADY_PX = 0.125  # largest change of the CoC over a block of columns that share a disc [px]
_NARROWEST = 4  # columns of a block, where the camera is rolled
_EVERY = 8  # rows and columns at which a map is compared with a plane
_BAND_ROWS = 16


class PlaneCoc(Struct, frozen=True):
    """Signed CoC diameter of a plane, affine across a picture [px, columns].

    Attributes:
        corner: at the first pixel [px].
        across: how it grows by column [1].
        down: how it grows by row [1].
    """

    corner: float
    across: float
    down: float

    @classmethod
    def of(cls, coc_px: Float32) -> PlaneCoc | None:
        """That of a map (h, w) of it; None where the map is not that of a plane."""
        height, width = coc_px.shape
        first, right, below = (float(coc_px[at]) for at in ((0, 0), (0, -1), (-1, 0)))
        across, down = (right - first) / max(width - 1, 1), (below - first) / max(height - 1, 1)
        plane = cls(first, across, down)
        rows, columns = np.arange(0, height, _EVERY)[:, None], np.arange(0, width, _EVERY)
        away = np.abs(plane.at(rows, columns) - coc_px[::_EVERY, ::_EVERY])
        return plane if float(away.max()) <= _STEADY_PX else None

    def largest_px(self, width: int, height: int) -> float:
        """The largest size on a picture [px]."""
        ends = np.array([[0.0], [height - 1.0]]), np.array([0.0, width - 1.0])
        return float(np.abs(self.at(*ends)).max())

    def at(self, rows: npt.ArrayLike, columns: npt.ArrayLike) -> Float64:
        """At rows and columns of that picture that broadcast [px]."""
        across, down = np.multiply(self.across, columns), np.multiply(self.down, rows)
        return np.asarray(self.corner + across + down, dtype=np.float64)


def blur_plane(
    values: Float32,
    coc: PlaneCoc,
    target: Box,
    pixel_aspect: float = 1.0,
    threads: int | None = None,
) -> Float32:
    """What a round lens makes of values on a plane, of which there are none beyond the array.

    Args:
        values: (h, w, 3), between 0 and 1.
        coc: of the plane, in their pixels; at most `LARGEST_COC_PX` on the target.
        target: where the result lies, in pixels of the array; may reach beyond it.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        threads: how many share the rows at most; default: one a processor. The result does not
            depend on it.

    Returns:
        The three values and their mean on the target (h, w, 4).
    """
    height, width = values.shape[:2]
    steady = _STEADY_PX / max(abs(coc.across), 1e-9)
    block = int(min(max(steady, _NARROWEST), max(target.width, 1)))
    rows = np.arange(target.y0, target.y1, dtype=np.float64)[:, None]
    columns = np.arange(target.x0, target.x1, block, dtype=np.float64) + 0.5 * (block - 1)
    radii = fitted_radii(0.5 * np.abs(coc.at(rows, columns)))
    beyond = max(0, -target.x0, target.x1 - width)
    pad = beyond + math.ceil(float(radii.max(initial=0.0))) + 2
    wide = width + 2 * pad
    sums = scratch("plane sums", (3, height, wide), np.int32)
    steps = scratch("plane steps", (3, height, wide))
    kernels.sum_plane_rows(np.ascontiguousarray(values), pad, sums, steps)
    out = np.empty((target.height, target.width, 4), np.float32)
    work = partial(
        kernels.blur_plane_rows, sums, steps, pad, radii, block, pixel_aspect,
        (target.y0, target.x0), out,
    )  # fmt: skip
    parallel_for(work, bands(target.height, _BAND_ROWS), threads)
    return out
