"""L by sampling the lens: the mean of the object rendered from many points of the aperture.

Each point stands for a cell of the aperture, so its picture is blurred over that cell's own small
disc of confusion before the mean is taken. Surfaces that one view does not show are misplaced by no
more than the parallax within one cell.

A drawn picture has four samples a pixel, so an edge that moves would go by quarters of one. Every
view is therefore shifted by a part of a pixel of its own, and where views are not needed the mean
of some shifted pictures is blurred.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.kernels.scatter.subaperture_gather import (
    LARGEST_RADIUS_PX,
    gather_subaperture,
    subaperture_reach,
)
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination
from nlens_video.stages.l_aperture_samples import LensPoints, lens_points, pixel_offsets
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, crop_to_frame, object_coc
from nlens_video.stages.l_view_mean import ViewMean, Vignette

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer

NEGLIGIBLE_PARALLAX_PX = 0.5  # up to which the whole aperture is scattered at once [px]
WHOLE_PARALLAX_PX = 1.5  # from which views alone count [px]
FEWEST_VIEWS, MOST_VIEWS = 8, 256
COVERAGE_DRAWS = 16  # shifted pictures of four samples a pixel
_DB_OF_ONE_VIEW = 35.5  # measured, see `view_count`

Reblur = Callable[[DefocusedLayer, Box], BlurredLayer]
MeanOf = Callable[[Iterable[ObjectLayer | None]], ObjectLayer | None]


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


def shifted_cameras(camera: Camera, count: int) -> list[Camera]:
    """The camera, its picture shifted by each of `count` parts of a pixel."""
    return [
        replace(camera, cx=camera.cx + x, cy=camera.cy + y)
        for x, y in pixel_offsets(count).tolist()
    ]


class LensSetup(Struct, frozen=True, kw_only=True):
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
    vignette = Vignette(frame, points, aperture) if aperture.cat_eye > 0.0 else None
    mean = ViewMean(frame, points, vignette)

    def add(at: int, layer: ObjectLayer | None) -> None:
        part = BlurredLayer.nothing()
        if layer is not None and cell is None:
            part = crop_to_frame(layer, frame)
        elif layer is not None and cell is not None:
            radius, fit = float(points.radii[at]), setup.fit
            of_cell = replace(fit, slope=fit.slope * radius, intercept=fit.intercept * radius)
            part = cell(object_coc(layer, of_cell), frame)
        mean.add(at, part)

    shifted = shifted_cameras(setup.camera, len(points.weights))
    cameras = [
        lens_camera(camera, setup.fit, u, v)
        for camera, (u, v) in zip(shifted, points.places.tolist(), strict=True)
    ]
    renderer.render_views(
        setup.time_s, cameras, margin, add, nearest=cell is not None, plate_light=setup.plate_light
    )
    return mean.layer


class BlurCell(Struct, frozen=True):
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


class SampleLens(Struct, frozen=True, kw_only=True):
    """L as a stage: the aperture sampled.

    Between both limits of the parallax the two methods are mixed, for they differ by some
    hundredths at edges: nothing pops in a focus pull.

    Attributes:
        renderer: draws the object from a point of the lens.
        whole: blurs a layer by the whole aperture at once, where there is hardly any parallax.
        mean: the mean of an object's sharp pictures.
        cell: blurs a view by a round disc.
        count: views [1].
        aperture: its shape.
    """

    renderer: BoxRenderer
    whole: Reblur
    mean: MeanOf
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
            return self._at_once(defocused, setup)
        views = self._views(defocused, setup)
        return views if share >= 1.0 else _mixed(self._at_once(defocused, setup), views, share)

    def _at_once(self, defocused: DefocusedLayer, setup: LensSetup) -> BlurredLayer:
        """The mean of shifted pictures, blurred by the whole aperture."""
        margin = _margin(setup, 0.5 * defocused.largest_coc_px)

        def drawn() -> Iterator[ObjectLayer | None]:
            for camera in shifted_cameras(setup.camera, COVERAGE_DRAWS):
                yield self.renderer.render(
                    setup.time_s, camera, margin, nearest=True, plate_light=setup.plate_light
                )

        layer = self.mean(drawn())
        if layer is None:
            return BlurredLayer.nothing()
        return self.whole(object_coc(layer, setup.fit), setup.frame)

    def _views(self, defocused: DefocusedLayer, setup: LensSetup) -> BlurredLayer:
        points = lens_points(self.count, self.aperture)
        margin = _margin(setup, 0.5 * defocused.largest_coc_px * float(points.radii.max()))
        return lens_views(
            self.renderer, setup, points, cell=self.cell, margin=margin, aperture=self.aperture
        )


def _margin(setup: LensSetup, radius_px: float) -> int:
    """How far beyond the frame a picture is drawn whose discs are as large [px]."""
    tall = max(1.0, setup.camera.fy / setup.camera.fx)
    reach = min(radius_px * tall, furthest_reach(tall))
    return math.ceil(reach) + 1 + max(0, -setup.frame.x0)


def _mixed(first: BlurredLayer, second: BlurredLayer, share: float) -> BlurredLayer:
    """Two pictures of one object, by the share of the second, 0 to 1, on the box of both."""
    box = first.box.union(second.box)
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    for part, weight in ((first, 1.0 - share), (second, share)):
        if not part.box.empty:
            rgba[part.box.slices_in(box)] += np.float32(weight) * part.rgba
    return BlurredLayer(box=box, rgba=rgba)
