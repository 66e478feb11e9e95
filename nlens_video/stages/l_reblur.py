"""L: the object as the plate's lens sees it (paper, section 4.2, "Lens Reblur").

The paper lets a network blur the naive composite. Here the clean plate is known, so the object's
premultiplied layer is scattered on its own and laid over the plate: exact wherever the object does
not hide parts of itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, ObjectLayer

NEGLIGIBLE_COC_PX = 0.5  # a disc this wide stays within its pixel
_LEAST_DEPTH = np.finfo(np.float32).tiny  # what is nearer has no disparity that a float can hold


class CocLaw(Protocol):
    """What gives a disparity its CoC: a `LensFit`, or a rival's model."""

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
    if known.any() and (covered & ~known).any():
        rows, columns = _nearest(known)
        disparity = disparity[rows, columns]
    coc = fit.coc_px(disparity)
    coc[~covered] = 0.0
    return DefocusedLayer(layer=layer, coc_px=coc)


def _nearest(
    known: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the nearest known pixel, for every pixel (H, W) each."""
    _, labels = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    seeds = np.flatnonzero(known.ravel())
    of_label = np.zeros(int(labels.max()) + 1, np.int64)
    of_label[labels.ravel()[seeds]] = seeds
    flat = of_label[labels]
    return flat // known.shape[1], flat % known.shape[1]


ScatterKernel = Callable[..., Float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReblurLayer:
    """L as a stage: scatter a layer with its CoC.

    Attributes:
        scatter: (rgba (h, w, 4), coc_px (h, w), pixel_aspect=, frame=) -> blurred rgba (h, w, 4);
            `frame` is the frame's box in pixels of the arrays.
        reach: (coc_px, alpha, pixel_aspect) -> pixels that the blur spreads beyond the silhouette.
        pixel_aspect: width of a pixel by its height [1].
    """

    scatter: ScatterKernel
    reach: Callable[[Float32, Float32, float], int]
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
        seen = Box(frame.x0 - wide.x0, frame.y0 - wide.y0, frame.x1 - wide.x0, frame.y1 - wide.y0)
        blurred = self.scatter(rgba, coc, pixel_aspect=self.pixel_aspect, frame=seen)
        box = wide.intersection(frame)
        if box.empty:
            return BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
        return BlurredLayer(box=box, rgba=blurred[box.slices_in(wide)])


def crop_to_frame(layer: ObjectLayer, frame: Box) -> BlurredLayer:
    """The sharp layer as it is, cut to the frame: what a lens in focus makes of it."""
    box = layer.box.intersection(frame)
    if box.empty:
        return BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
    return BlurredLayer(box=box, rgba=layer.rgba[box.slices_in(layer.box)])
