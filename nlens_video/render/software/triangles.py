"""Triangle set-up: culling, and the plane equations of the barycentric weights.

Barycentric weights divided by depth are affine across the screen: three planes, from which all
attributes are interpolated; their sum is disparity.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32, Float64
from nlens_video.native import kernels

Int32 = npt.NDArray[np.int32]
Shape = tuple[Float64, Float32, Int32, Float64]
"""Points (V, 3) from `screen_projection.project`, positions (V, 3), faces (F, 3), camera
parameters."""

SAMPLES = 4
"""Samples of a pixel, each on a line of its own."""
PLANES = 16
"""Numbers of a triangle's planes."""


def set_up(
    shape: Shape, sides: npt.NDArray[np.uint8], width: int, lines: int,
    spans: Int32, planes: Float32, kept: Int32,
) -> int:  # fmt: skip
    """Find the triangles that are turned to the camera and touch the picture.

    Args:
        shape: the triangles on the screen.
        sides: of each triangle (F,): bit 0 whether its back is drawn, bit 1 whether mirrored.
        width: columns of the picture [px].
        lines: lines of samples, four a row of pixels.
        spans: filled in: first and last line of each kept triangle (F, 2).
        planes: filled in: plane numbers of each kept triangle (F, 16).
        kept: filled in: indices of the kept triangles, ascending (F,).

    Returns:
        How many are kept.
    """
    return kernels.set_up_triangles(shape, sides, width, lines, spans, planes, kept)
