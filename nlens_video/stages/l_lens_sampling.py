"""L by sampling the lens: the mean of the object rendered from many points of the aperture.

Each point stands for a cell of the aperture, so its picture is blurred over that cell's own small
disc of confusion before the mean is taken. Surfaces that one view does not show are misplaced by no
more than the parallax within one cell.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.kernels.scatter.shape import barrel_centre, outer_radius
from nlens_video.kernels.scatter.subaperture_gather import (
    LARGEST_RADIUS_PX,
    gather_subaperture,
    subaperture_reach,
)
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination
from nlens_video.stages.l_aperture_samples import LensPoints, lens_points
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, crop_to_frame, object_coc

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer

NEGLIGIBLE_PARALLAX_PX = 0.5  # up to which the whole aperture is scattered at once [px]
WHOLE_PARALLAX_PX = 1.5  # from which views alone count [px]
FEWEST_VIEWS, MOST_VIEWS = 8, 256
_DB_OF_ONE_VIEW = 35.5  # measured, see `view_count`

Reblur = Callable[[DefocusedLayer, Box], BlurredLayer]


def view_count(accuracy_db: float) -> int:
    """Number of views for a PSNR against a thousand views without cells.

    Both the cells' discs and the parallax within them shrink with the root of the count, so the
    mean square error falls at least in proportion to it, and hardly depends on the CoC. Measured
    on the scenes of `bench`, the PSNR is at least 35.5 + 10 log10(count) dB from 16 views on; 8 to
    12 may stray up to 0.9 dB below. A narrow blurred card before one in focus comes near to that,
    a figure gives 8 dB more. Fewer than 8 cells do not tile a disc well.

    Args:
        accuracy_db: wanted PSNR in the object's region, display-coded [dB].
    """
    count = math.ceil(math.pow(10.0, 0.1 * (accuracy_db - _DB_OF_ONE_VIEW)) - 1e-9)
    return min(max(count, FEWEST_VIEWS), MOST_VIEWS)


def parallax_px(defocused: DefocusedLayer) -> float:
    """Largest less smallest signed CoC: parallax within the object across the aperture [px]."""
    coc = defocused.coc_px[defocused.layer.rgba[..., 3] > 0]
    return float(coc.max() - coc.min()) if coc.size else 0.0


def lens_camera(camera: Camera, fit: LensFit, u: float, v: float) -> Camera:
    """The camera moved to a point of the aperture, with the same focal plane.

    A point of disparity d appears `fit.coc_px(d) / 2 * (u, v)` from where the centre sees it
    (rows times the pixel aspect: the disc is round on the sensor). A fit of slope 0 moves nothing
    but the principal point.

    Args:
        camera: at the centre of the lens.
        fit: the lens, in the pixels of that camera.
        u: along columns [radius of the aperture].
        v: along rows, downwards [radius of the aperture].
    """
    away = -0.5 * fit.slope / camera.fx
    pose = camera.world_from_camera.copy()
    pose[:3, 3] += pose[:3, 0] * (away * u) - pose[:3, 1] * (away * v)
    return replace(
        camera,
        world_from_camera=pose,
        cx=camera.cx + 0.5 * fit.intercept * u,
        cy=camera.cy + 0.5 * fit.intercept * v * camera.fy / camera.fx,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LensSetup:
    """A lens at one moment.

    Attributes:
        time_s: time of the animation [s].
        camera: at the centre of the lens.
        fit: the lens, in the pixels of the frame.
        frame: the frame's own box.
        plate_light: lights the object where its file does not; None for a plausible light.
    """

    time_s: float
    camera: Camera
    fit: LensFit
    frame: Box
    plate_light: Illumination | None = None


def lens_views(
    renderer: BoxRenderer,
    setup: LensSetup,
    points: LensPoints,
    *,
    cell: Reblur | None = None,
    margin: int = 0,
    aperture: Aperture = ROUND,
) -> BlurredLayer:
    """The mean of an object's pictures from points of the aperture.

    Args:
        renderer: draws the object; called on this thread.
        setup: lens and moment.
        points: points of the aperture and their weights.
        cell: blurs a picture over its cell's disc; None takes the pictures as they are, the
            ground truth, for which a thousand points are enough.
        margin: how far beyond the frame the pictures are drawn, for what `cell` spreads [px].
        aperture: for its cat's eye; the rest of its shape is in the points.

    Returns:
        Premultiplied scene-linear, on the pixels that any of the pictures reach.
    """
    frame = setup.frame
    vignette = _Vignette(frame, points, aperture) if aperture.cat_eye > 0.0 else None
    mean = _Mean(frame, points, vignette)

    def add(at: int, layer: ObjectLayer | None) -> None:
        part = BlurredLayer.nothing()
        if layer is not None and cell is None:
            part = crop_to_frame(layer, frame)
        elif layer is not None and cell is not None:
            radius, fit = float(points.radii[at]), setup.fit
            of_cell = replace(fit, slope=fit.slope * radius, intercept=fit.intercept * radius)
            part = cell(object_coc(layer, of_cell), frame)
        mean.add(at, part)

    cameras = [lens_camera(setup.camera, setup.fit, u, v) for u, v in points.places.tolist()]
    renderer.render_views(
        setup.time_s, cameras, margin, add, nearest=cell is not None, plate_light=setup.plate_light
    )
    return mean.layer


class _Mean:
    """Sums views up in their order, whichever is ready first: any number of threads may add."""

    def __init__(self, frame: Box, points: LensPoints, vignette: _Vignette | None) -> None:
        self._frame, self._points, self._vignette = frame, points, vignette
        self._total = np.zeros((frame.height, frame.width, 4), np.float32)
        self._box = Box(0, 0, 0, 0)
        self._ready: dict[int, BlurredLayer] = {}
        self._next = 0
        self._lock = threading.Lock()

    def add(self, at: int, part: BlurredLayer) -> None:
        """Add a view; it is kept until those before it are added."""
        with self._lock:
            self._ready[at] = part
            while self._next in self._ready:
                self._sum_up(self._next, self._ready.pop(self._next))
                self._next += 1

    def _sum_up(self, at: int, part: BlurredLayer) -> None:
        if part.box.empty:
            return
        weight = np.float32(self._points.weights[at])
        shaded = weight if self._vignette is None else self._vignette.weight(at, part.box)
        self._total[part.box.slices_in(self._frame)] += shaded * part.rgba
        self._box = self._box.union(part.box)

    @property
    def layer(self) -> BlurredLayer:
        """The mean, on the pixels that any view reaches."""
        return BlurredLayer(box=self._box, rgba=self._total[self._box.slices_in(self._frame)])


class _Vignette:
    """Weights of the views where the barrel hides part of the aperture."""

    def __init__(self, frame: Box, points: LensPoints, aperture: Aperture) -> None:
        self._frame, self._points, self._aperture = frame, points, aperture
        self._rim = outer_radius(aperture)
        self._total = np.zeros((frame.height, frame.width, 1), np.float32)
        for at in range(len(points.weights)):
            self._total += self._seen(at, frame)

    def weight(self, at: int, box: Box) -> Float32:
        """Weight (h, w, 1) of a view on a box of the frame; over all views they sum to 1."""
        return np.asarray(self._seen(at, box) / self._total[box.slices_in(self._frame)])

    def _seen(self, at: int, box: Box) -> Float32:
        # points are places before the focus, the barrel lies as a highlight behind it shows it
        u, v = -self._points.places[at]
        columns = np.arange(box.x0, box.x1, dtype=np.float64) + 0.5
        rows = np.arange(box.y0, box.y1, dtype=np.float64) + 0.5
        size = (self._frame.width, self._frame.height)
        x, y = barrel_centre(self._aperture, columns, rows, size)
        off = np.hypot(u - x[None, :], v - y[:, None])
        share = np.clip((self._rim - off) / (2.0 * self._points.radii[at]) + 0.5, 0.0, 1.0)
        seen = self._points.weights[at] * np.maximum(share, 1e-6)
        return np.asarray(seen[..., None], dtype=np.float32)


@dataclass(frozen=True, slots=True)
class BlurCell:
    """Blurs a view over the disc of its cell.

    Attributes:
        scatter: blurs discs that are too large to gather.
        pixel_aspect: width of a pixel by its height [1].
    """

    scatter: Reblur
    pixel_aspect: float = 1.0

    def __call__(self, defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
        """Blur one view, with the CoC of its cell; the frame's own box bounds the result."""
        layer, largest = defocused.layer, defocused.largest_coc_px
        if largest < NEGLIGIBLE_COC_PX:
            return crop_to_frame(layer, frame)
        if largest > 2.0 * LARGEST_RADIUS_PX:
            return self.scatter(defocused, frame)
        box = layer.box.expanded(subaperture_reach(largest, self.pixel_aspect)).intersection(frame)
        x, y = layer.box.x0, layer.box.y0
        target = Box(box.x0 - x, box.y0 - y, max(box.x0, box.x1) - x, max(box.y0, box.y1) - y)
        rgba = gather_subaperture(
            layer.rgba, layer.rgba[..., 3] > 0.0, defocused.coc_px, target,
            pixel_aspect=self.pixel_aspect,
        )  # fmt: skip
        return BlurredLayer(box=box, rgba=rgba)


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleLens:
    """L as a stage: the aperture sampled.

    Between both limits of the parallax the two methods are mixed, for they differ by some
    hundredths at edges: nothing pops in a focus pull.

    Attributes:
        renderer: draws the object from a point of the lens.
        whole: blurs a layer by the whole aperture at once, where there is hardly any parallax.
        cell: blurs a view by a round disc.
        count: views [1].
        aperture: its shape.
    """

    renderer: BoxRenderer
    whole: Reblur
    cell: Reblur
    count: int
    aperture: Aperture = ROUND

    def __call__(self, defocused: DefocusedLayer, setup: LensSetup) -> BlurredLayer:
        """Blur one frame's object.

        Args:
            defocused: the object as the lens' centre sees it.
            setup: lens and moment.
        """
        above = parallax_px(defocused) - NEGLIGIBLE_PARALLAX_PX
        share = above / (WHOLE_PARALLAX_PX - NEGLIGIBLE_PARALLAX_PX)
        if share <= 0.0:
            return self.whole(defocused, setup.frame)
        views = self._views(defocused, setup)
        return views if share >= 1.0 else _mixed(self.whole(defocused, setup.frame), views, share)

    def _views(self, defocused: DefocusedLayer, setup: LensSetup) -> BlurredLayer:
        points = lens_points(self.count, self.aperture)
        tall = max(1.0, setup.camera.fy / setup.camera.fx)
        reach = 0.5 * defocused.largest_coc_px * float(points.radii.max()) * tall
        margin = math.ceil(min(reach, furthest_reach(tall))) + 1 + max(0, -setup.frame.x0)
        return lens_views(
            self.renderer, setup, points, cell=self.cell, margin=margin, aperture=self.aperture
        )


def _mixed(first: BlurredLayer, second: BlurredLayer, share: float) -> BlurredLayer:
    """Two pictures of one object, by the share of the second, 0 to 1, on the box of both."""
    box = first.box.union(second.box)
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    for part, weight in ((first, 1.0 - share), (second, share)):
        if not part.box.empty:
            rgba[part.box.slices_in(box)] += np.float32(weight) * part.rgba
    return BlurredLayer(box=box, rgba=rgba)
