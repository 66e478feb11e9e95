"""L, where the object hides parts of itself: depth order at discontinuities of its CoC.

A scatter has no depth order. Around every step of the CoC the object is split in two layers. Each
is scattered on its own, and the near one composited over the back one, less the covariance of their
coverages across the aperture. A network that sees geometry alone, never colour, estimates for every
pixel the weight of the ordered layers against the plain scatter, and a correction of the near
layer's coverage: a thin part fills its antialiased pixels only in part. So the result is linear in
light whatever its exposure, and does not flicker with the texture. After BokehMe's hybrid (Peng et
al. 2022): classical result, neural result, error map.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32
from nlens_video.kernels.aperture_covariance import aperture_covariance
from nlens_video.kernels.coc_discontinuities import (
    CocDiscontinuities,
    HiddenSurface,
    extend_nearest,
    find_discontinuities,
)
from nlens_video.kernels.depth_layers import cut_share, split_at_hidden, split_at_steps
from nlens_video.kernels.thread_pool import parallel_map
from nlens_video.stages.l_aperture_samples import even_points
from nlens_video.stages.l_reblur import Reach

CHANNELS = 11
"""Maps that the network reads."""

POINTS = (16, 32, 64)
"""Points of the aperture for a covariance: at least one for each pixel of the largest disc's width,
as long as there are so many. Fewer show as specks where a large disc meets a thin part."""

CELL = 4
"""Pixels that the network takes together, each way; cells are those of the frame [px]."""

HALO_PX = 24
"""Context of a pixel that the network sees; a multiple of `CELL` [px]."""

FEATHER_PX = 3.0
"""Width over which the repair fades in at the border of its region [px]."""

_BESIDE_PX = 2_000_000
"""Largest layers that are scattered beside each other, for each takes 150 bytes a pixel [px]."""
_COC_SCALE = 1.0 / 32.0
_COC_LIMIT = 1.25  # of the scaled CoC: the network's training range
_CLEAR = 1e-3  # coverage this near to 0 or 1 has a negligible covariance

Scatter = Callable[..., Float32]
RepairNetwork = Callable[[Float32], Float32]
"""Maps of `Candidates.geometry` (h, w, CHANNELS), h and w multiples of CELL, to (h, w, 2): weight
of the ordered layers in the result, in [0, 1], and relative change of the near layer's coverage, in
[-0.5, 0.5]."""


class Candidates(Struct, frozen=True, kw_only=True):
    """Candidates for the blurred object, premultiplied scene-linear (h, w, 4).

    Attributes:
        scattered: all at once, without order.
        near: the near layer alone, scattered.
        back: the back layer alone, scattered.
        covariance: of coverage and light across the aperture, 0 where not needed.
        geometry: input of the network (h, w, CHANNELS), without colour, 0 out of reach of a step;
            None where hidden surfaces are known and no network is needed.
    """

    scattered: Float32
    near: Float32
    back: Float32
    covariance: Float32
    geometry: Float32 | None = None

    def resolve(self, judgement: Float32 | None, where: Float32) -> Float32:
        """The result (h, w, 4).

        Alpha stays within 0 and 1. Light is no lower than the candidates' own negative light, that
        of colours beyond BT.709; else 0.

        Args:
            judgement: the network's answer (h, w, 2); None trusts the ordered layers.
            where: share of the repair (h, w), 0 where the scatter stands.
        """
        swapped = self.near - self.near[..., 3:] * self.back  # near light for the back it covers
        share = where[..., None]
        if judgement is not None:
            share = share * judgement[..., :1]
            swapped *= 1.0 + judgement[..., 1:]
        ordered = self.back + swapped - self.covariance
        out = self.scattered + share * (ordered - self.scattered)
        low = np.unravel_index(np.flatnonzero(out < 0.0), out.shape)
        parts = (self.scattered[low], self.near[low], self.back[low])
        out[low] = np.maximum(out[low], sum(np.minimum(part, 0.0) for part in parts))
        np.minimum(out[..., 3], 1.0, out=out[..., 3])
        return out


def candidates(
    layer: tuple[Float32, Float32],
    scattered: Float32,
    steps: CocDiscontinuities,
    scatter: Scatter,
    *,
    pixel_aspect: float = 1.0,
    corner: tuple[int, int] = (0, 0),
    hidden: HiddenSurface | None = None,
) -> Candidates:
    """Compute the candidates on one region.

    Args:
        layer: sharp premultiplied colour and alpha (h, w, 4) and signed CoC diameter (h, w) [px],
            with a margin of at least a disc around the pixels that count.
        scattered: the scatter of the whole object (h, w, 4).
        steps: the discontinuities.
        scatter: (rgba, coc_px, pixel_aspect=, wanted=) -> blurred rgba.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        corner: row and column of the region's first pixel in the frame [px].
        hidden: the second surface, where that is known.
    """
    rgba, coc = layer
    if hidden is None:
        parts = split_at_steps(rgba, coc, steps, corner)
    else:
        parts = split_at_hidden(rgba, coc, steps, hidden)
    reached = steps.inside_px > 0.0
    drawn = partial(scatter, pixel_aspect=pixel_aspect, wanted=reached)

    def spread(part: tuple[Float32, Float32]) -> tuple[Float32, Float32]:
        return drawn(*part), extend_nearest(part[1], part[0][..., 3] > 0.0)

    # in parallel: single-threaded work on one layer overlaps with the other
    (back, back_coc), (near, near_coc) = parallel_map(
        spread,
        [(parts.back_rgba, parts.back_coc_px), (parts.near_rgba, parts.near_coc_px)],
        1 if coc.size > _BESIDE_PX else None,
    )
    near_alpha = np.ascontiguousarray(parts.near_rgba[..., 3])
    coverage = near[..., 3]
    partly = reached & (coverage > _CLEAR) & (coverage < 1.0 - _CLEAR) & (back[..., 3] > _CLEAR)
    largest = max(float(np.abs(one).max(initial=0.0, where=partly)) for one in (near_coc, back_coc))
    enough = next((count for count in POINTS if count >= largest), POINTS[-1])
    covariance = aperture_covariance(
        (near_alpha, near_coc),
        (parts.back_rgba, back_coc),
        partly,
        even_points(enough),
        pixel_aspect=pixel_aspect,
    )
    made = Candidates(scattered=scattered, near=near, back=back, covariance=covariance)
    if hidden is not None:  # the network's weight is mostly about surfaces that are not known
        return made
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
    geometry = np.stack(maps, axis=2) * reached[..., None]
    return replace(made, geometry=geometry)


def _scaled(coc_px: Float32) -> Float32:
    scaled = np.clip(coc_px * _COC_SCALE, -_COC_LIMIT, _COC_LIMIT)
    return np.asarray(scaled, dtype=np.float32)


class RepairDepthOrder(Struct, frozen=True, kw_only=True):
    """Depth order as a stage; works on the surroundings of discontinuities only.

    Attributes:
        network: weighs the candidates.
        scatter: (rgba (h, w, 4), coc_px (h, w), pixel_aspect=, wanted=) -> blurred rgba (h, w, 4).
        reach: (coc_px, alpha, pixel_aspect) -> pixels that the blur spreads beyond the silhouette.
        pixel_aspect: width of a pixel by its height [1].
    """

    network: RepairNetwork
    scatter: Scatter
    reach: Reach
    pixel_aspect: float = 1.0

    def __call__(self, defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        """Repair one frame; without a discontinuity the very same layer is returned.

        Args:
            defocused: the sharp object and its CoC.
            blurred: its scatter.
        """
        layer = defocused.layer
        margin = self.reach(defocused.coc_px, layer.rgba[..., 3], self.pixel_aspect)
        whole = layer.box.expanded(margin + 1)
        rgba, coc = _on(whole, layer.box, layer.rgba), _on(whole, layer.box, defocused.coc_px)
        hidden = _hidden_on(whole, defocused, rgba)
        steps = find_discontinuities(rgba, coc, hidden)
        if steps is None or blurred.box.empty:
            return blurred
        where = fade(steps.inside_px)
        doubt = None if hidden is None else cut_share(rgba, coc, steps, hidden)
        if doubt is not None:
            where *= 1.0 - doubt
        reached = Box.of(steps.inside_px > 0.0).translated(whole.x0, whole.y0)
        reached = reached.intersection(blurred.box.expanded(HALO_PX))
        touched = reached.intersection(blurred.box)
        if touched.empty:
            return blurred
        source = reached.expanded(margin + 1)
        rgba, coc = _on(source, whole, rgba), _on(source, whole, coc)
        steps = CocDiscontinuities(
            inside_px=_on(source, whole, steps.inside_px),
            split_px=_on(source, whole, steps.split_px),
        )
        if hidden is not None:
            hidden = HiddenSurface(
                rgba=_on(source, whole, hidden.rgba),
                coc_px=_on(source, whole, hidden.coc_px),
                front_rgba=_on(source, whole, hidden.front_rgba),
            )
        made = candidates(
            (rgba, coc),
            _on(source, blurred.box, blurred.rgba),
            steps,
            self.scatter,
            pixel_aspect=self.pixel_aspect,
            corner=(source.y0, source.x0),
            hidden=hidden,
        )
        judgement = None
        if made.geometry is not None:
            seen = _in_cells(touched.expanded(HALO_PX))
            judged = self.network(_on(seen, reached, made.geometry[reached.slices_in(source)]))
            judgement = judged[touched.slices_in(seen)]
        inside = touched.slices_in(source)
        part = Candidates(
            scattered=made.scattered[inside],
            near=made.near[inside],
            back=made.back[inside],
            covariance=made.covariance[inside],
        )
        where = where[touched.slices_in(whole)]
        repaired = blurred.rgba.copy()
        target = repaired[touched.slices_in(blurred.box)]
        np.copyto(target, part.resolve(judgement, where), where=(where > 0.0)[..., None])
        return BlurredLayer(box=blurred.box, rgba=repaired)


def fade(inside_px: Float32) -> Float32:
    """Share of the repair (h, w): 0 at the border of its region, 1 `FEATHER_PX` inside it."""
    return np.asarray(np.clip(inside_px * (1.0 / FEATHER_PX), 0.0, 1.0), dtype=np.float32)


def _in_cells(box: Box) -> Box:
    """The box expanded to whole cells of the frame, so that the answer does not depend on it."""
    x0, y0 = box.x0 // CELL * CELL, box.y0 // CELL * CELL
    return Box(x0, y0, -(-box.x1 // CELL) * CELL, -(-box.y1 // CELL) * CELL)


def _hidden_on(box: Box, defocused: DefocusedLayer, rgba: Float32) -> HiddenSurface | None:
    """The second surface on `box`, None where it is not known; `rgba` is the first one there."""
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


def _on(box: Box, held: Box, values: Float32) -> Float32:
    """The values that lie on `held`, on `box`; 0 beyond."""
    common = box.intersection(held)
    out = np.zeros((box.height, box.width, *values.shape[2:]), dtype=np.float32)
    if not common.empty:
        out[common.slices_in(box)] = values[common.slices_in(held)]
    return out
