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

from nlens_video.frames import BlurredLayer, Box, DefocusedLayer, Float32
from nlens_video.kernels.aperture_covariance import aperture_covariance, aperture_points
from nlens_video.kernels.depth_layers import Steps, carried_out, find_steps, split_at_steps

CHANNELS = 11
"""Maps that the network reads."""

CELL = 4
"""Pixels that the network takes together, each way; cells are those of the frame [px]."""

HALO_PX = 24
"""How far the network looks around a pixel; a multiple of `CELL` [px]."""

FEATHER_PX = 3.0
"""Over how many pixels the repair fades in at the rim of what it may touch [px]."""

_COC_SCALE = 1.0 / 32.0
_COC_LIMIT = 1.25  # of the scaled CoC: what the network was trained to
_CLEAR = 1e-3  # coverage this near to 0 or 1 has no covariance to speak of

Scatter = Callable[..., Float32]


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
class Candidates:
    """What a pixel of the blurred object may be, all premultiplied scene-linear (h, w, 4).

    Attributes:
        scattered: all at once, without order.
        near: the near layer alone, scattered.
        back: the back layer alone, scattered.
        covariance: of coverage and light across the aperture, 0 where not needed.
        geometry: what the network judges by (h, w, CHANNELS), without colour; 0 out of reach of
            a step, so that nothing there need be known.
    """

    scattered: Float32
    near: Float32
    back: Float32
    covariance: Float32
    geometry: Float32

    def mended(self, judgement: Float32, where: Float32) -> Float32:
        """The result (h, w, 4).

        Args:
            judgement: the network's answer (h, w, 2).
            where: share of the repair (h, w), 0 where the scatter stands.
        """
        share = (judgement[..., 0] * where)[..., None]
        swapped = self.near - self.near[..., 3:] * self.back  # near light for the back it covers
        ordered = self.back + (1.0 + judgement[..., 1:]) * swapped - self.covariance
        out = self.scattered + share * (ordered - self.scattered)
        np.maximum(out, 0.0, out=out)
        np.minimum(out[..., 3], 1.0, out=out[..., 3])
        return out


def candidates(
    layer: tuple[Float32, Float32],
    scattered: Float32,
    steps: Steps,
    scatter: Scatter,
    *,
    pixel_aspect: float = 1.0,
    corner: tuple[int, int] = (0, 0),
) -> Candidates:
    """Make the candidates on one region.

    Args:
        layer: sharp premultiplied colour and alpha (h, w, 4) and signed CoC diameter (h, w) [px],
            at least a disc farther on every side than the pixels that count.
        scattered: what the scatter made of the whole object (h, w, 4).
        steps: where the CoC steps.
        scatter: (rgba, coc_px, pixel_aspect=) -> blurred rgba.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        corner: row and column of the region's first pixel in the frame [px].
    """
    rgba, coc = layer
    parts = split_at_steps(rgba, coc, steps, corner)
    near = scatter(parts.near_rgba, parts.near_coc_px, pixel_aspect=pixel_aspect)
    back = scatter(parts.back_rgba, parts.back_coc_px, pixel_aspect=pixel_aspect)
    near_alpha = np.ascontiguousarray(parts.near_rgba[..., 3])
    near_coc = carried_out(parts.near_coc_px, near_alpha > 0.0)
    back_coc = carried_out(parts.back_coc_px, parts.back_rgba[..., 3] > 0.0)
    coverage = near[..., 3]
    partly = (steps.inside_px > 0.0) & (coverage > _CLEAR) & (coverage < 1.0 - _CLEAR)
    covariance = aperture_covariance(
        (near_alpha, near_coc),
        (parts.back_rgba, back_coc),
        partly,
        aperture_points(),
        pixel_aspect=pixel_aspect,
    )
    maps = [
        _scaled(np.where(rgba[..., 3] > 0.0, coc, np.float32(0.0))),
        _scaled(near_coc),
        _scaled(back_coc),
        _scaled(steps.split_px),
        np.minimum(steps.inside_px * np.float32(1.0 / 16.0), np.float32(1.0)),
        rgba[..., 3],
        near_alpha,
        scattered[..., 3],
        coverage,
        back[..., 3],
        covariance[..., 3],
    ]
    return Candidates(
        scattered=scattered,
        near=near,
        back=back,
        covariance=covariance,
        geometry=np.stack(maps, axis=2) * (steps.inside_px > 0.0)[..., None],
    )


def _scaled(coc_px: Float32) -> Float32:
    scaled = np.clip(coc_px * _COC_SCALE, -_COC_LIMIT, _COC_LIMIT)
    return np.asarray(scaled, dtype=np.float32)


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairLayer:
    """L's repair as a stage, a `ReblurNetwork`; works on the surroundings of depth steps only.

    Attributes:
        network: judges by geometry.
        scatter: (rgba (h, w, 4), coc_px (h, w), pixel_aspect=) -> blurred rgba (h, w, 4).
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
        whole = layer.box.grown(margin + 1)
        rgba, coc = _on(whole, layer.box, layer.rgba), _on(whole, layer.box, defocused.coc_px)
        steps = find_steps(rgba, coc)
        if steps is None or blurred.box.empty:
            return blurred
        reached = _reached(steps, whole).intersection(blurred.box.grown(HALO_PX))
        touched = reached.intersection(blurred.box)
        if touched.empty:
            return blurred
        source = reached.grown(margin + 1)
        made = candidates(
            (_on(source, whole, rgba), _on(source, whole, coc)),
            _on(source, blurred.box, blurred.rgba),
            Steps(
                inside_px=_on(source, whole, steps.inside_px),
                split_px=_on(source, whole, steps.split_px),
            ),
            self.scatter,
            pixel_aspect=self.pixel_aspect,
            corner=(source.y0, source.x0),
        )
        seen = _in_cells(touched.grown(HALO_PX))
        judged = made.geometry[reached.slices_in(source)]
        judgement = self.network(_on(seen, reached, judged))
        return self._laid_in(made, judgement, steps, (touched, seen, source, whole), blurred)

    @staticmethod
    def _laid_in(
        made: Candidates,
        judgement: Float32,
        steps: Steps,
        boxes: tuple[Box, Box, Box, Box],
        blurred: BlurredLayer,
    ) -> BlurredLayer:
        touched, seen, source, whole = boxes
        inside = touched.slices_in(source)
        part = Candidates(
            scattered=made.scattered[inside],
            near=made.near[inside],
            back=made.back[inside],
            covariance=made.covariance[inside],
            geometry=made.geometry[inside],
        )
        where = fade(steps.inside_px[touched.slices_in(whole)])
        mended = part.mended(judgement[touched.slices_in(seen)], where)
        rgba = blurred.rgba.copy()
        target = rgba[touched.slices_in(blurred.box)]
        np.copyto(target, mended, where=(where > 0.0)[..., None])
        return BlurredLayer(box=blurred.box, rgba=rgba)


def fade(inside_px: Float32) -> Float32:
    """Share of the repair (h, w), from 0 at the rim of what a step reaches to 1 further in."""
    return np.asarray(np.clip(inside_px * (1.0 / FEATHER_PX), 0.0, 1.0), dtype=np.float32)


def _reached(steps: Steps, whole: Box) -> Box:
    """Bounds in the frame of what is within reach of a step."""
    rows = np.flatnonzero((steps.inside_px > 0.0).any(axis=1))
    columns = np.flatnonzero((steps.inside_px > 0.0).any(axis=0))
    return Box(
        whole.x0 + int(columns[0]),
        whole.y0 + int(rows[0]),
        whole.x0 + int(columns[-1]) + 1,
        whole.y0 + int(rows[-1]) + 1,
    )


def _in_cells(box: Box) -> Box:
    """The box grown to whole cells of the frame, so that the answer moves with the object only."""
    x0, y0 = box.x0 // CELL * CELL, box.y0 // CELL * CELL
    return Box(x0, y0, -(-box.x1 // CELL) * CELL, -(-box.y1 // CELL) * CELL)


def _on(box: Box, held: Box, values: Float32) -> Float32:
    """The values that lie on `held`, on `box`; 0 beyond."""
    common = box.intersection(held)
    out = np.zeros((box.height, box.width, *values.shape[2:]), dtype=np.float32)
    if not common.empty:
        out[common.slices_in(box)] = values[common.slices_in(held)]
    return out
