"""Alpha-tested (MASK) and blended (BLEND) triangles, pixel by pixel.

Blending runs from near to far: each sample stores its remaining transmittance only, no colour.
"""

from __future__ import annotations

from nlens_video.core.layers import Float32
from nlens_video.native import kernels
from nlens_video.render.software.shading_inputs import (
    Int32,
    MaterialBuffers,
    MeshBuffers,
    ShadingInputs,
)
from nlens_video.render.software.triangles import Shape

OnScreen = tuple[Shape, Int32]
"""The triangles on the screen, and first and last line of samples of each (F, 2)."""


def cut_out(
    drawn: Int32, rows: tuple[int, int], width: int, on_screen: OnScreen, mesh: MeshBuffers,
    paint: MaterialBuffers, most: Float32, disparity: Float32, ids: Int32,
) -> None:  # fmt: skip
    """Draw masked triangles on rows [first, last), as `raster.fill` draws opaque ones.

    `most` (h, w) limits the disparity, (0, 0) does not.
    """
    kernels.cut_out_triangles(drawn, rows, width, on_screen, mesh, paint, most, disparity, ids)


def blend(
    drawn: Int32, rows: tuple[int, int], width: int, on_screen: OnScreen, scene: ShadingInputs,
    disparity: Float32, passed: Float32, front: Float32, rgba: Float32,
) -> None:  # fmt: skip
    """Add the light of blended triangles to rows [first, last) of the picture.

    Args:
        drawn: the triangles, from near to far.
        rows: first row, and one beyond the last [px].
        width: columns of the picture [px].
        on_screen: the triangles on the screen, and first and last line of samples of each (F, 2).
        scene: what to shade with.
        disparity: of the opaque surface at each sample [1 / scene unit], as of `raster.fill`.
        passed: changed: share of light that gets through to each sample, likewise.
        front: changed: disparity of the nearest surface at each sample, likewise.
        rgba: changed: premultiplied linear light (h * width, 4).
    """
    kernels.blend_triangles(
        drawn, rows, width, on_screen, scene, disparity, (passed, front, rgba)
    )  # fmt: skip
