"""L, where discs are small: the mean of a few aperture views in place of the scatter.

A pixel of the sharp picture is a mean over its own square, of four samples. Where the disc is
hardly larger, no kernel recovers what the disc mixes: the best is 39 to 47 dB. Views from other
points of the aperture are such means half a pixel on, with the right parallax. So the mean of five
views, each blurred over its cell of the aperture, replaces the scatter there; where discs are
large, five views would show as five.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.coc_discontinuities import chamfer
from nlens_video.kernels.scatter.subaperture_gather import gather_subaperture, subaperture_reach
from nlens_video.kernels.thread_pool import Band, bands, parallel_for
from nlens_video.stages.l_aperture_samples import points_around
from nlens_video.stages.l_lens_sampling import LensSetup, lens_camera
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, object_coc

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer

SMALL_COC_PX = 3.0  # CoC up to which the views replace the scatter [px]
LARGE_COC_PX = 6.0  # CoC from which they have no weight [px]
SPARE_PX = 2.0  # margin around the reach of large discs in which they have no weight [px]
FADE_PX = 6.0  # width over which their weight grows to 1 from there [px]
VIEWS = 4  # views beside that of the lens' centre, which is rendered already
BAND_ROWS = 32  # rows that a thread takes at a time


class ViewBlend(Struct, frozen=True, kw_only=True, eq=False):
    """The mean of a few aperture views, with its weight.

    Attributes:
        box: where the arrays lie, a part of the frame.
        rgba: premultiplied scene-linear mean of the views (h, w, 4).
        share: its weight in the result (h, w), 0 to 1 [1].
    """

    box: Box
    rgba: Float32
    share: Float32

    def blend_into(self, blurred: BlurredLayer) -> BlurredLayer:
        """The layer with its share of the views, on the box of `blurred`."""
        common = self.box.intersection(blurred.box)
        if common.empty:
            return blurred
        rgba = blurred.rgba.copy()
        target, here = rgba[common.slices_in(blurred.box)], common.slices_in(self.box)
        target += self.share[here][..., None] * (self.rgba[here] - target)
        return BlurredLayer(box=blurred.box, rgba=rgba)


@dataclass(slots=True, kw_only=True)
class SampleSmallDiscs:
    """Aperture views as a stage; an object at rest is not rendered again.

    Attributes:
        renderer: draws the object from a point of the lens.
        pixel_aspect: width of a pixel by its height [1].
        aperture: its shape; a cat's eye is not seen in discs as small as these.
    """

    renderer: BoxRenderer
    pixel_aspect: float = 1.0
    aperture: Aperture = ROUND
    _last: tuple[ObjectLayer, LensFit, Box, ViewBlend | None] | None = field(
        default=None, init=False
    )

    def __call__(self, defocused: DefocusedLayer, setup: LensSetup) -> ViewBlend | None:
        """Sample the lens; None where no disc is small enough.

        Args:
            defocused: the object as the lens' centre sees it.
            setup: lens and moment.
        """
        last, layer = self._last, defocused.layer  # at rest the renderer gives the same layer
        if last is not None and last[0] is layer and last[1:3] == (setup.fit, setup.frame):
            return last[3]
        seen = self._sampled(defocused, setup)
        self._last = (layer, setup.fit, setup.frame, seen)
        return seen

    def _sampled(self, defocused: DefocusedLayer, setup: LensSetup) -> ViewBlend | None:
        whole = min((defocused.largest_coc_px - NEGLIGIBLE_COC_PX) / NEGLIGIBLE_COC_PX, 1.0)
        box, part = share_of_views(defocused, setup.frame)
        if whole <= 0.0 or box.empty:
            return None
        points = points_around(VIEWS, self.aperture)
        region = box.expanded(
            subaperture_reach(LARGE_COC_PX * float(points.radii.max()), self.pixel_aspect)
        )
        places, radii = points.places.tolist(), points.radii.tolist()
        away = [n for n, (u, v) in enumerate(places) if u != 0.0 or v != 0.0]
        parts = {
            n: self._blurred(defocused, radii[n], box) for n in {*range(len(places))} - {*away}
        }

        def blur(at: int, layer: ObjectLayer | None) -> None:
            if layer is not None:
                moved = replace(layer, box=layer.box.translated(region.x0, region.y0))
                view = object_coc(moved, setup.fit)
                parts[away[at]] = self._blurred(view, radii[away[at]], box)

        camera = setup.camera.cropped(region)
        cameras = [lens_camera(camera, setup.fit, *places[n]) for n in away]
        self.renderer.render_views(
            setup.time_s, cameras, 0, blur, nearest=True, plate_light=setup.plate_light
        )
        mean = np.zeros((box.height, box.width, 4), np.float32)
        for n in sorted(parts):
            mean += np.float32(points.weights[n]) * parts[n]
        np.minimum(mean[..., 3], 1.0, out=mean[..., 3])  # weights sum to 1 but for their rounding
        return ViewBlend(box=box, rgba=mean, share=part * np.float32(whole))

    def _blurred(self, view: DefocusedLayer, radius: float, box: Box) -> Float32:
        """A view over the disc of its cell (h, w, 4), discs limited to `LARGE_COC_PX`."""
        at = view.layer.box
        coc = np.clip(view.coc_px, -LARGE_COC_PX, LARGE_COC_PX) * np.float32(radius)
        covered = view.layer.rgba[..., 3] > 0.0
        out = np.empty((box.height, box.width, 4), np.float32)

        def rows(band: Band) -> None:
            part = Box(box.x0, box.y0 + band[0], box.x1, box.y0 + band[1])
            out[band[0] : band[1]] = gather_subaperture(
                view.layer.rgba, covered, coc, part.translated(-at.x0, -at.y0),
                pixel_aspect=self.pixel_aspect,
            )  # fmt: skip

        parallel_for(rows, bands(box.height, BAND_ROWS), None)
        return out


def share_of_views(defocused: DefocusedLayer, frame: Box) -> tuple[Box, Float32]:
    """Where discs are small: the least box, and the weight of the views on it (h, w) [1].

    Light of a large disc may lie over or under that of small ones wherever it reaches, so the
    scatter keeps all of that. The weight is continuous in CoC and distance, so it adds no step of
    its own. The views go by steps all the same: an edge that passes one of the four samples of one
    of the five changes a pixel by a twentieth, where two pass at once by a tenth. Another turn of
    the ring only moves the places; nine views would halve the steps, for twice the renderings.

    Args:
        defocused: the object as the lens' centre sees it.
        frame: bounds the box.
    """
    size = np.abs(defocused.coc_px)
    covered = defocused.layer.rgba[..., 3] > 0.0
    found = Box.of(covered & (size < LARGE_COC_PX))
    held = defocused.layer.box
    box = found.translated(held.x0, held.y0).expanded(math.ceil(LARGE_COC_PX)).intersection(frame)
    if found.empty or box.empty:
        return Box(0, 0, 0, 0), np.zeros((0, 0), np.float32)
    large = np.clip((size - SMALL_COC_PX) / (LARGE_COC_PX - SMALL_COC_PX), 0.0, 1.0)
    around = box.union(held)
    reach = np.zeros((around.height, around.width), np.float32)
    reach[held.slices_in(around)] = np.where(covered, large * (0.5 * size + SPARE_PX), 0.0)
    chamfer(reach)
    share = 1.0 - np.minimum(reach[box.slices_in(around)] / np.float32(FADE_PX), np.float32(1.0))
    return box, np.asarray(share, np.float32)
