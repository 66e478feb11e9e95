"""Visibility: the nearest triangle of each sample (scanline rasterisation with a depth test).

A pixel has four samples in the rotated-grid pattern of graphics hardware. Their rows lie a quarter
of a pixel apart, so the picture is `4 h` lines of one sample a pixel, and a triangle covers one run
of each line. A sample stores its triangle and disparity, which is affine across the screen; shading
follows once per surface and pixel (`deferred`).
"""

from __future__ import annotations

from nlens_video.core.layers import Float32
from nlens_video.native import kernels
from nlens_video.render.software.triangles import Int32, Shape

SAMPLE_X = (0.375, 0.875, 0.125, 0.625)
SAMPLE_Y = (0.125, 0.375, 0.625, 0.875)
"""Where in a pixel its samples lie [px]."""
PADDING = kernels.PADDING
"""Columns stored to the right of the picture, of any content."""
NOTHING = -1
"""No triangle."""


def fill(
    drawn: Int32, first: int, last: int, shape: Shape, spans: Int32, width: int,
    disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw triangles on the lines [first, last]; of equal disparities the later one stays.

    Args:
        drawn: the triangles, in the order in which they are drawn.
        first: first line of samples.
        last: last line.
        shape: the triangles on the screen.
        spans: from `triangles.set_up` (F, 2).
        width: columns of the picture [px].
        disparity: changed: of each sample (4 h, width + PADDING), 0 where there is nothing
            [1 / scene unit].
        ids: changed: triangle of each sample (4 h, width + PADDING).
    """
    kernels.fill_triangles(drawn, first, last, shape, spans, width, disparity, ids)


def fill_behind(
    drawn: Int32, rows: tuple[int, int], drawn_shape: tuple[Shape, Int32], most: Float32,
    planes: Float32, disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw triangles on rows [first, last) where they lie behind others, as `fill` does.

    Args:
        drawn: the triangles, in the order in which they are drawn.
        rows: first row, and one beyond the last [px].
        drawn_shape: the triangles on the screen, and first and last line of samples of each (F, 2).
        most: largest disparity that is drawn in each pixel (h, w) [1 / scene unit].
        planes: from `triangles.set_up` (F, 16).
        disparity: changed, as by `fill`.
        ids: changed.
    """
    shape, spans = drawn_shape
    first, last = 4 * rows[0], 4 * rows[1] - 1
    kernels.fill_triangles_behind(
        drawn, first, last, shape, spans, most, planes, disparity, ids
    )  # fmt: skip
