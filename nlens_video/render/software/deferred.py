"""Deferred shading: each surface visible in a pixel is shaded once; resolve of its depth.

Samples of triangles that share a vertex are one surface: normals and texture coordinates are
continuous across the edge, so one shading serves all of them. At hard edges vertices are split, and
each side is shaded. This keeps meshes finer than the pixels affordable. Depth is that of a pixel's
nearest surface, never a mean of two.
"""

from __future__ import annotations

from nlens_video.core.layers import Float32
from nlens_video.native import kernels
from nlens_video.render.software.shading_inputs import Int32, ShadingInputs


def shade_rows(
    first: int, last: int, width: int, ids: Int32, passed: Float32, scene: ShadingInputs,
    rgba: Float32,
) -> None:  # fmt: skip
    """Add the light of the opaque surfaces to rows [first, last) of the picture.

    Args:
        first: first row [px].
        last: one beyond the last row [px].
        width: columns of the picture [px].
        ids: triangle of each sample, as of `raster.fill`.
        passed: share of light that reaches each sample, likewise; (0, 0) for all of it.
        scene: what to shade with.
        rgba: changed: premultiplied linear light (h * width, 4).
    """
    kernels.shade_rows(first, last, width, ids, passed, scene, rgba)


def resolve_depth(
    disparity: Float32, first: int, last: int, least: float, depth: Float32
) -> None:  # fmt: skip
    """Fill in depths (h, w) on rows [first, last), +inf where nothing is [scene unit].

    Where all samples lie on one surface, their mean disparity, which is affine across the screen,
    is that at the pixel's centre. `least` is the disparity of a surface beyond all others, which
    stands for nothing; a sample of 0 shows nothing [1 / scene unit].
    """
    kernels.resolve_depth(disparity, first, last, least, depth)
