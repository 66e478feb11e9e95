"""L: the object as the plate's lens sees it (paper, section 4.2, "Lens Reblur").

The paper lets a network blur the naive composite. Here the clean plate is known, so the object's
premultiplied layer is scattered on its own and laid over the plate: exact wherever the object does
not hide parts of itself. Those come from depth peeling (Everitt 2001).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    Float32,
    HiddenLayer,
    ObjectLayer,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.coc_discontinuities import STEP_PX, extend_nearest

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer

NEGLIGIBLE_COC_PX = 0.5  # a disc this wide stays within its pixel
_LEAST_DEPTH = np.finfo(np.float32).tiny  # what is nearer has no disparity that a float can hold

ScatterKernel = Callable[..., Float32]
Reach = Callable[[Float32, Float32, float], int]


class CocLaw(Protocol):
    """CoC as a function of disparity: a `LensFit`, or a rival's model."""

    def coc_px(self, disparity: Float32) -> Float32:
        """Signed CoC diameter [px] of any shape from disparity [1 / scene unit]."""
        ...


def object_coc(layer: ObjectLayer, fit: CocLaw) -> DefocusedLayer:
    """CoC of a rendered object from its depth (paper, eq. 2 applied).

    Pixels that have alpha but no depth (an antialiased edge whose depth sample missed) take the
    depth of their nearest neighbour that has one.

    Args:
        layer: the sharp object on the frame that the fit counts its pixels in.
        fit: the lens.
    """
    covered = layer.rgba[..., 3] > 0
    known = covered & np.isfinite(layer.depth) & (layer.depth >= _LEAST_DEPTH)
    disparity = np.zeros_like(layer.depth)
    np.divide(1.0, layer.depth, out=disparity, where=known)
    if (covered & ~known).any():
        disparity = extend_nearest(disparity, known)
    coc = fit.coc_px(disparity)
    coc[~covered] = 0.0
    return DefocusedLayer(layer=layer, coc_px=coc)


def depth_peel(
    defocused: DefocusedLayer, fit: LensFit, farthest: float, renderer: BoxRenderer
) -> DefocusedLayer:
    """The layer with the second surface behind it, where their CoCs differ by a visible step.

    Args:
        defocused: the object, from a layer of that renderer.
        fit: the lens, in the pixels of the frame, with a slope > 0.
        farthest: greatest depth of the object [scene unit].
        renderer: draws the second surface.
    """
    layer = defocused.layer
    # only what has a CoC of a step above the least can hide anything
    least = fit.coc_px(np.array([1.0 / farthest], np.float32))[0] + np.float32(STEP_PX)
    near = (layer.rgba[..., 3] > 0) & (defocused.coc_px >= least)
    region = Box.of(near).translated(layer.box.x0, layer.box.y0)
    seen = None
    if not region.empty:
        seen = renderer.render_behind(layer, region, STEP_PX / fit.slope)
    if seen is None:
        return replace(defocused, behind=HiddenLayer.nothing())
    behind = HiddenLayer(
        box=region,
        rgba=seen.hidden.rgba,
        coc_px=object_coc(seen.hidden, fit).coc_px,
        front_rgba=seen.front_rgba,
    )
    return replace(defocused, behind=behind)


class ReblurLayer(Struct, frozen=True, kw_only=True):
    """L as a stage: scatter a layer with its CoC.

    Attributes:
        scatter: (rgba (h, w, 4), coc_px (h, w), pixel_aspect=, frame=) -> blurred rgba (h, w, 4);
            `frame` is the frame's box in pixels of the arrays.
        reach: (coc_px, alpha, pixel_aspect) -> pixels that the blur spreads beyond the silhouette.
        pixel_aspect: width of a pixel by its height [1].
    """

    scatter: ScatterKernel
    reach: Reach
    pixel_aspect: float = 1.0

    def __call__(self, defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
        """Blur one layer.

        Args:
            defocused: the sharp layer and its CoC; it may reach beyond the frame.
            frame: the frame's own box, which bounds the result.
        """
        layer = defocused.layer
        if defocused.largest_coc_px < NEGLIGIBLE_COC_PX:
            return crop_to_frame(layer, frame)
        margin = self.reach(defocused.coc_px, layer.rgba[..., 3], self.pixel_aspect)
        wide = layer.box.expanded(margin)
        rgba = np.pad(layer.rgba, ((margin, margin), (margin, margin), (0, 0)))
        coc = np.pad(defocused.coc_px, margin)
        seen = frame.translated(-wide.x0, -wide.y0)
        blurred = self.scatter(rgba, coc, pixel_aspect=self.pixel_aspect, frame=seen)
        box = wide.intersection(frame)
        if box.empty:
            return BlurredLayer.nothing()
        return BlurredLayer(box=box, rgba=blurred[box.slices_in(wide)])


def crop_to_frame(layer: ObjectLayer, frame: Box) -> BlurredLayer:
    """The sharp layer cut to the frame: what a lens in focus makes of it."""
    box = layer.box.intersection(frame)
    if box.empty:
        return BlurredLayer.nothing()
    return BlurredLayer(box=box, rgba=layer.rgba[box.slices_in(layer.box)])
