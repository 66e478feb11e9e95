"""L, where the object hides parts of itself: order between its parts, which scatter cannot know.

Around every step of the CoC the object is cut in two layers. Each is scattered on its own, and the
near one laid over the back one, with the covariance across the aperture that this leaves out. A
network that sees geometry alone, never colour, then says for every pixel how far the scatter or
the ordered layers are right, and how much less the near layer covers than its pixels say: a thin
part fills its antialiased pixels only in part. So the result is linear in light whatever its
exposure, and does not flicker with the texture. After BokehMe's hybrid (Peng et al. 2022):
classical result, neural result, error map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32
from nlens_video.kernels.reblur.coc_discontinuities import (
    CocDiscontinuities,
    HiddenSurface,
    find_discontinuities,
)
from nlens_video.stages.reblur.depth_order import Candidates, Scatter, candidates

CELL = 4
"""Pixels that the network takes together, each way; cells are those of the frame [px]."""

HALO_PX = 24
"""How far the network looks around a pixel; a multiple of `CELL` [px]."""

FEATHER_PX = 3.0
"""Over how many pixels the repair fades in at the rim of what it may touch [px]."""


class RepairNetwork(Protocol):
    """Says from geometry how to mend a blurred layer."""

    def __call__(self, geometry: Float32) -> Float32:
        """Judge one region.

        Args:
            geometry: maps of `Candidates.geometry` (h, w, CHANNELS), h and w multiples of CELL.

        Returns:
            (h, w, 2): share of the ordered layers in the result, in [0, 1], and relative change
            of the near layer's coverage, in [-0.5, 0.5].
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairDepthOrder:
    """L's repair as a stage, a `ReblurNetwork`; works on the surroundings of depth steps only.

    Attributes:
        network: judges by geometry.
        scatter: (rgba (h, w, 4), coc_px (h, w), pixel_aspect=, wanted=) -> blurred rgba (h, w, 4).
        reach: (coc_px, alpha, pixel_aspect) -> pixels that the blur spreads beyond the silhouette.
        pixel_aspect: width of a pixel by its height [1].
    """

    network: RepairNetwork
    scatter: Scatter
    reach: Callable[[Float32, Float32, float], int]
    pixel_aspect: float = 1.0

    def __call__(self, defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        """Repair one frame; without a depth step the very layer that came.

        Args:
            defocused: the sharp object and its CoC.
            blurred: what the scatter made of it.
        """
        layer = defocused.layer
        margin = self.reach(defocused.coc_px, layer.rgba[..., 3], self.pixel_aspect)
        whole = layer.box.expanded(margin + 1)
        rgba, coc = _on(whole, layer.box, layer.rgba), _on(whole, layer.box, defocused.coc_px)
        hidden = _hidden_on(whole, defocused, rgba)
        steps = find_discontinuities(rgba, coc, hidden)
        if steps is None or blurred.box.empty:
            return blurred
        reached = _reached(steps, whole).intersection(blurred.box.expanded(HALO_PX))
        touched = reached.intersection(blurred.box)
        if touched.empty:
            return blurred
        source = reached.expanded(margin + 1)
        made = candidates(
            (_on(source, whole, rgba), _on(source, whole, coc)),
            _on(source, blurred.box, blurred.rgba),
            CocDiscontinuities(
                inside_px=_on(source, whole, steps.inside_px),
                split_px=_on(source, whole, steps.split_px),
            ),
            self.scatter,
            pixel_aspect=self.pixel_aspect,
            corner=(source.y0, source.x0),
            hidden=None if hidden is None else _hidden_part(hidden, source, whole),
        )
        seen = _in_cells(touched.expanded(HALO_PX))
        judgement = None
        if made.geometry is not None:
            judged = self.network(_on(seen, reached, made.geometry[reached.slices_in(source)]))
            judgement = judged[touched.slices_in(seen)]
        return self._laid_in(made, judgement, steps, (touched, source, whole), blurred)

    @staticmethod
    def _laid_in(
        made: Candidates,
        judgement: Float32 | None,
        steps: CocDiscontinuities,
        boxes: tuple[Box, Box, Box],
        blurred: BlurredLayer,
    ) -> BlurredLayer:
        touched, source, whole = boxes
        inside = touched.slices_in(source)
        part = Candidates(
            scattered=made.scattered[inside],
            near=made.near[inside],
            back=made.back[inside],
            covariance=made.covariance[inside],
        )
        where = fade(steps.inside_px[touched.slices_in(whole)])
        mended = part.resolve(judgement, where)
        rgba = blurred.rgba.copy()
        target = rgba[touched.slices_in(blurred.box)]
        np.copyto(target, mended, where=(where > 0.0)[..., None])
        return BlurredLayer(box=blurred.box, rgba=rgba)


def fade(inside_px: Float32) -> Float32:
    """Share of the repair (h, w), from 0 at the rim of what a step reaches to 1 further in."""
    return np.asarray(np.clip(inside_px * (1.0 / FEATHER_PX), 0.0, 1.0), dtype=np.float32)


def _reached(steps: CocDiscontinuities, whole: Box) -> Box:
    """Bounds in the frame of what is within reach of a step."""
    return Box.of(steps.inside_px > 0.0).moved(whole.x0, whole.y0)


def _in_cells(box: Box) -> Box:
    """The box grown to whole cells of the frame, so that the answer moves with the object only."""
    x0, y0 = box.x0 // CELL * CELL, box.y0 // CELL * CELL
    return Box(x0, y0, -(-box.x1 // CELL) * CELL, -(-box.y1 // CELL) * CELL)


def _hidden_on(box: Box, defocused: DefocusedLayer, rgba: Float32) -> HiddenSurface | None:
    """What is hidden, on `box`; None where nobody knows. `rgba` is the sharp picture on it."""
    behind = defocused.behind
    if behind is None:
        return None
    front = rgba.copy()
    if not behind.box.empty:
        front[behind.box.slices_in(box)] = behind.front_rgba
    return HiddenSurface(
        rgba=_on(box, behind.box, behind.rgba),
        coc_px=_on(box, behind.box, behind.coc_px),
        front_rgba=front,
    )


def _hidden_part(hidden: HiddenSurface, box: Box, held: Box) -> HiddenSurface:
    """Of what is hidden on `held`, that on `box`."""
    return HiddenSurface(
        rgba=_on(box, held, hidden.rgba),
        coc_px=_on(box, held, hidden.coc_px),
        front_rgba=_on(box, held, hidden.front_rgba),
    )


def _on(box: Box, held: Box, values: Float32) -> Float32:
    """The values that lie on `held`, on `box`; 0 beyond."""
    common = box.intersection(held)
    out = np.zeros((box.height, box.width, *values.shape[2:]), dtype=np.float32)
    if not common.empty:
        out[common.slices_in(box)] = values[common.slices_in(held)]
    return out
