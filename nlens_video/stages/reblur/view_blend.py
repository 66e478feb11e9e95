"""A few points of the lens where discs are small: what one antialiased picture does not hold.

A pixel of the sharp picture is a mean already, over its own square and four samples of it. Where
the disc is hardly larger, that says too little of what the disc mixes, and no kernel brings it
back: the best is 39 to 47 dB. Pictures from other points of the lens are such means elsewhere, half
a pixel on, with the right parallax. So there the mean of five views, each blurred over its cell of
the aperture, stands for the scatter; where discs are large, five would show as five.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.reblur.coc_discontinuities import chamfer
from nlens_video.kernels.reblur.subaperture_gather import gather_subaperture, subaperture_reach
from nlens_video.kernels.scatter.extend import Band, bands
from nlens_video.kernels.thread_pool import parallel_for
from nlens_video.scene.camera import Camera
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, object_coc
from nlens_video.stages.protocols import ViewRenderer
from nlens_video.stages.reblur.aperture_samples import points_around
from nlens_video.stages.reblur.lens_sampling import LensSetup, lens_camera

SMALL_COC_PX = 3.0
"""CoC up to which the views stand alone [px]."""

LARGE_COC_PX = 6.0
"""CoC from which they do not count [px]."""

SPARE_PX = 2.0
"""How much farther than a large disc reaches the views do not count whole [px]."""

FADE_PX = 6.0
"""Over how many pixels inwards from there they fade out [px]."""

BAND_ROWS = 32
"""Rows that a thread takes at a time."""

VIEWS = 4
"""Views beside that of the lens' centre, which is drawn already [1]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ViewBlend:
    """What a few points of the lens see.

    Attributes:
        box: where, a part of the frame.
        rgba: premultiplied scene-linear mean of them (h, w, 4).
        share: of the result that is theirs (h, w), 0 to 1 [1].
    """

    box: Box
    rgba: Float32
    share: Float32

    def blend_into(self, blurred: BlurredLayer) -> BlurredLayer:
        """The layer (h, w, 4) with its share of the views; what lies beside `blurred` is lost."""
        common = self.box.intersection(blurred.box)
        if common.empty:
            return blurred
        rgba = blurred.rgba.copy()
        target, here = rgba[common.slices_in(blurred.box)], common.slices_in(self.box)
        target += self.share[here][..., None] * (self.rgba[here] - target)
        return BlurredLayer(box=blurred.box, rgba=rgba)


@dataclass(slots=True, kw_only=True)
class SampleSmallDiscs:
    """L's few views as a stage; an object at rest is not drawn again.

    Attributes:
        renderer: draws the object from a point of the lens.
        pixel_aspect: width of a pixel by its height [1].
        aperture: its shape; a cat's eye is not seen in discs as small as these.
    """

    renderer: ViewRenderer
    pixel_aspect: float = 1.0
    aperture: Aperture = ROUND
    _last: tuple[ObjectLayer, LensFit, Box, ViewBlend | None] | None = field(
        default=None, init=False
    )

    def __call__(self, defocused: DefocusedLayer, shot: LensSetup) -> ViewBlend | None:
        """Look from a few points of the lens.

        Args:
            defocused: the object as the lens' centre sees it.
            shot: the same moment.

        Returns:
            What they see; None where no disc is small enough.
        """
        last, layer = self._last, defocused.layer  # at rest the renderer gives the same layer
        if last is not None and last[0] is layer and last[1:3] == (shot.fit, shot.frame):
            return last[3]
        seen = self._sampled(defocused, shot)
        self._last = (layer, shot.fit, shot.frame, seen)
        return seen

    def _sampled(self, defocused: DefocusedLayer, shot: LensSetup) -> ViewBlend | None:
        whole = min((defocused.largest_coc_px - NEGLIGIBLE_COC_PX) / NEGLIGIBLE_COC_PX, 1.0)
        box, part = share_of_views(defocused, shot.frame)
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
                moved = replace(layer, box=layer.box.moved(region.x0, region.y0))
                view = object_coc(moved, shot.fit)
                parts[away[at]] = self._blurred(view, radii[away[at]], box)

        cameras = [_on(shot, region, *places[n]) for n in away]
        self.renderer.render_views(
            shot.time_s, cameras, 0, blur, nearest=True, plate_light=shot.plate_light
        )
        mean = np.zeros((box.height, box.width, 4), np.float32)
        for n in sorted(parts):
            mean += np.float32(points.weights[n]) * parts[n]
        np.minimum(mean[..., 3], 1.0, out=mean[..., 3])  # weights sum to 1 but for their rounding
        return ViewBlend(box=box, rgba=mean, share=part * np.float32(whole))

    def _blurred(self, view: DefocusedLayer, radius: float, box: Box) -> Float32:
        """A view over the disc of its cell (h, w, 4), larger discs than count cut short."""
        at = view.layer.box
        coc = np.clip(view.coc_px, -LARGE_COC_PX, LARGE_COC_PX) * np.float32(radius)
        covered = view.layer.rgba[..., 3] > 0.0
        out = np.empty((box.height, box.width, 4), np.float32)

        def rows(band: Band) -> None:
            part = Box(box.x0, box.y0 + band[0], box.x1, box.y0 + band[1])
            out[band[0] : band[1]] = gather_subaperture(
                view.layer.rgba, covered, coc, part.moved(-at.x0, -at.y0),
                pixel_aspect=self.pixel_aspect,
            )  # fmt: skip

        parallel_for(rows, bands(box.height, BAND_ROWS), None)
        return out


def _on(shot: LensSetup, region: Box, u: float, v: float) -> Camera:
    """The camera at a point of the lens, on a region of the frame."""
    camera = replace(
        shot.camera,
        cx=shot.camera.cx - region.x0,
        cy=shot.camera.cy - region.y0,
        width=region.width,
        height=region.height,
    )
    return lens_camera(camera, shot.fit, u, v)


def share_of_views(defocused: DefocusedLayer, frame: Box) -> tuple[Box, Float32]:
    """Where discs are small: the least box, and how much there the views count (h, w) [1].

    Light of a large disc can be wherever it reaches, over or under that of small ones, so all of
    that is left to who orders large discs. The share falls steadily with the CoC and with the
    distance: nothing pops.

    Args:
        defocused: the object as the lens' centre sees it.
        frame: bounds the box.
    """
    size = np.abs(defocused.coc_px)
    covered = defocused.layer.rgba[..., 3] > 0.0
    found = Box.of(covered & (size < LARGE_COC_PX))
    held = defocused.layer.box
    box = found.moved(held.x0, held.y0).expanded(math.ceil(LARGE_COC_PX)).intersection(frame)
    if found.empty or box.empty:
        return Box(0, 0, 0, 0), np.zeros((0, 0), np.float32)
    large = np.clip((size - SMALL_COC_PX) / (LARGE_COC_PX - SMALL_COC_PX), 0.0, 1.0)
    around = box.union(held)
    reach = np.zeros((around.height, around.width), np.float32)
    reach[held.slices_in(around)] = np.where(covered, large * (0.5 * size + SPARE_PX), 0.0)
    chamfer(reach)
    share = 1.0 - np.minimum(reach[box.slices_in(around)] / np.float32(FADE_PX), np.float32(1.0))
    return box, np.asarray(share, np.float32)
