"""What a pixel of a blurred object may be where its CoC steps: scattered at once, or in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.reblur.aperture_covariance import aperture_covariance
from nlens_video.kernels.reblur.coc_discontinuities import (
    CocDiscontinuities,
    HiddenSurface,
    extend_nearest,
)
from nlens_video.kernels.reblur.depth_layers import split_at_hidden, split_at_steps
from nlens_video.kernels.thread_pool import parallel_map
from nlens_video.stages.reblur.aperture_samples import even_points

CHANNELS = 11
"""Maps that the network reads."""

POINTS = 16
"""Points of the aperture that suffice for a covariance."""

_COC_SCALE = 1.0 / 32.0
_COC_LIMIT = 1.25  # of the scaled CoC: what the network was trained to
_CLEAR = 1e-3  # coverage this near to 0 or 1 has no covariance to speak of

Scatter = Callable[..., Float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidates:
    """What a pixel of the blurred object may be, all premultiplied scene-linear (h, w, 4).

    Attributes:
        scattered: all at once, without order.
        near: the near layer alone, scattered.
        back: the back layer alone, scattered.
        covariance: of coverage and light across the aperture, 0 where not needed.
        geometry: what the network judges by (h, w, CHANNELS), without colour; 0 out of reach of
            a step, so that nothing there need be known. None where nothing is to be judged.
    """

    scattered: Float32
    near: Float32
    back: Float32
    covariance: Float32
    geometry: Float32 | None = None

    def resolve(self, judgement: Float32 | None, where: Float32) -> Float32:
        """The result (h, w, 4).

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
        np.maximum(out, 0.0, out=out)
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
    """Make the candidates on one region.

    Args:
        layer: sharp premultiplied colour and alpha (h, w, 4) and signed CoC diameter (h, w) [px],
            at least a disc farther on every side than the pixels that count.
        scattered: what the scatter made of the whole object (h, w, 4).
        steps: where the CoC steps.
        scatter: (rgba, coc_px, pixel_aspect=, wanted=) -> blurred rgba.
        pixel_aspect: width of a pixel by its height, > 0 [1].
        corner: row and column of the region's first pixel in the frame [px].
        hidden: what the nearest surfaces hide, where that is known.
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

    # Side by side: what is done on a single thread for one goes on beside the other.
    (back, back_coc), (near, near_coc) = parallel_map(
        spread, [(parts.back_rgba, parts.back_coc_px), (parts.near_rgba, parts.near_coc_px)]
    )
    near_alpha = np.ascontiguousarray(parts.near_rgba[..., 3])
    coverage = near[..., 3]
    partly = reached & (coverage > _CLEAR) & (coverage < 1.0 - _CLEAR) & (back[..., 3] > _CLEAR)
    covariance = aperture_covariance(
        (near_alpha, near_coc),
        (parts.back_rgba, back_coc),
        partly,
        even_points(POINTS),
        pixel_aspect=pixel_aspect,
    )
    made = Candidates(scattered=scattered, near=near, back=back, covariance=covariance)
    if hidden is not None:  # what the network weighs is mostly what is not known
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
