"""Compositing: the blurred object over the plate, behind foreground mattes.

Plain alpha compositing assumes that every aperture sample sees the same background. Past a blurred
edge the object hides part of the aperture, and the rest sees the background from one side:
displaced by the background's own CoC. On the ground plane, as far as the plate shows it, the fit
gives that CoC.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.aperture_covariance import edge_parallax_layer
from nlens_video.kernels.channels import scaled_pixels
from nlens_video.kernels.coc_discontinuities import extend_nearest
from nlens_video.scene.camera import Camera

LARGEST_PARALLAX_PX = 48
"""Limit of the plate's displacement [px]."""


class ForegroundMatte(Struct, frozen=True, kw_only=True, eq=False):
    """Matte of a real thing in front of a layer, on a box of the frame.

    Attributes:
        box: where the arrays lie; inside the frame.
        coverage: share of each pixel (h, w) that it covers, 0 to 1 [1].
        light: its scene-linear light, premultiplied by that (h, w, 3).
    """

    box: Box
    coverage: Float32
    light: Float32


class Foreground(Struct, frozen=True, kw_only=True, eq=False):
    """Foreground mattes of one frame; None: nothing in front.

    Attributes:
        before_object: of things nearer than the object.
        before_ground: of things nearer than the ground that the plate would show.
        before_shadow: of what hides the object's shadow; not of things on which it falls.
    """

    before_object: ForegroundMatte | None
    before_ground: ForegroundMatte | None
    before_shadow: ForegroundMatte | None


def composite(
    picture: Picture, blurred: BlurredLayer, foreground: Foreground | None = None
) -> Picture:
    """Composite the object over the plate in place, in scene-linear light; returns the picture.

    Samples that the object does not reach keep their exact values.

    Args:
        picture: the plate; changed.
        blurred: the object as the lens sees it.
        foreground: what stands in front of it.
    """
    if not blurred.box.empty:
        matte = None if foreground is None else foreground.before_object
        composite_behind(picture, blurred.box, blurred.rgba, matte)
    return picture


def composite_behind(
    picture: Picture, box: Box, rgba: Float32, matte: ForegroundMatte | None
) -> None:
    """Composite a layer over the plate, behind a foreground.

    Without foreground this is `Picture.composite_over`; samples behind full coverage stay.

    Args:
        picture: the plate; changed.
        box: where the layer lies; inside the frame.
        rgba: premultiplied scene-linear layer (h, w, 4).
        matte: of the foreground.
    """
    if matte is not None:
        common = box.intersection(matte.box)
        if not common.empty:
            rgba = rgba.copy()
            inside, at = common.slices_in(box), common.slices_in(matte.box)
            rgba[inside] = behind(
                rgba[inside], picture.linear(common), matte.coverage[at], matte.light[at]
            )
    picture.composite_over(box, rgba)


def behind(rgba: Float32, plate: Float32, coverage: Float32, light: Float32) -> Float32:
    """The layer whose *over* on a plate puts another layer behind a foreground.

    Args:
        rgba: premultiplied layer (h, w, 4).
        plate: scene-linear light (h, w, 3), with all layers behind the same foreground so far.
        coverage: of the foreground (h, w) [1].
        light: of the foreground, premultiplied (h, w, 3).

    Returns:
        (h, w, 4), all 0 where the coverage is 1; its light may be negative where the foreground is
        darker than the background.
    """
    free, alpha = np.float32(1.0) - coverage, rgba[..., 3]
    lost = light - scaled_pixels(plate, coverage)
    hidden = scaled_pixels(rgba, free)
    hidden[..., :3] += scaled_pixels(lost, alpha)
    alone, none = (coverage <= 0.0).view(np.uint8), (coverage >= 1.0).view(np.uint8)
    cv2.copyTo(np.ascontiguousarray(rgba), alone, hidden)
    cv2.copyTo(np.zeros_like(hidden), none, hidden)
    return hidden


class EdgeSurroundings(Struct, frozen=True, kw_only=True, eq=False):
    """Where the plate shows past an object's edges, whatever its picture.

    Attributes:
        object_coc: CoC of the object's nearest pixel (h, w) [px].
        plate_coc: CoC of the plate behind it (h, w) [px].
        share: how much of the plate is ground of that CoC (h, w), 0 to 1 [1].
        margin: how far outside the plate is seen [px].
        pixel_aspect: width of a pixel by its height [1].
    """

    object_coc: Float32
    plate_coc: Float32
    share: Float32
    margin: int
    pixel_aspect: float


def edge_surroundings(
    box: Box, defocused: DefocusedLayer, fit: LensFit, camera: Camera, ground_y: float
) -> EdgeSurroundings | None:
    """What `apply_edge_parallax` needs beside the plate, on the box of the blurred layer.

    Args:
        box: of the object as the lens sees it, inside the frame.
        defocused: the sharp object and its CoC.
        fit: the lens, and how much of the ground the plate shows.
        camera: of the frame.
        ground_y: height of the ground plane in the world [scene unit].

    Returns:
        None where the plate shows as it is.
    """
    if box.empty or defocused.layer.box.empty or not fit.ground_seen:
        return None
    disparity = np.maximum(camera.cropped(box).plane_disparity(ground_y), 0.0).astype(np.float32)
    share = fit.ground_share(disparity)
    if not share.any():
        return None
    object_coc = _nearest_coc(defocused, box)
    plate_coc = np.minimum(fit.coc_px(disparity), object_coc)  # it is behind the object
    aspect = camera.fy / camera.fx
    farthest = 0.5 * float(np.abs(plate_coc[share > 0.0]).max()) * max(1.0, aspect)
    margin = math.ceil(min(farthest, LARGEST_PARALLAX_PX)) + 1
    return EdgeSurroundings(
        object_coc=object_coc, plate_coc=plate_coc, share=share, margin=margin, pixel_aspect=aspect
    )


def apply_edge_parallax(
    blurred: BlurredLayer, picture: Picture, around: EdgeSurroundings | None
) -> BlurredLayer:
    """The object's layer, with the plate past its edges as the free part of the aperture sees it.

    Args:
        blurred: the object as the lens sees it, inside the frame.
        picture: the plate; unchanged.
        around: from `edge_surroundings`, on the same box.
    """
    if around is None:
        return blurred
    box = blurred.box
    wide = box.expanded(around.margin).intersection(Box(0, 0, picture.width, picture.height))
    rgba = edge_parallax_layer(
        blurred.rgba, picture.linear(wide), around.object_coc, around.plate_coc, around.share,
        corner=(box.y0 - wide.y0, box.x0 - wide.x0), pixel_aspect=around.pixel_aspect,
    )  # fmt: skip
    return BlurredLayer(box=box, rgba=rgba)


def _nearest_coc(defocused: DefocusedLayer, box: Box) -> Float32:
    """The CoC of the object's nearest covered pixel (h, w), on a box."""
    held = defocused.layer.box
    whole = held.union(box)
    coc = np.zeros((whole.height, whole.width), np.float32)
    covered = np.zeros(coc.shape, np.bool_)
    coc[held.slices_in(whole)] = defocused.coc_px
    covered[held.slices_in(whole)] = defocused.layer.rgba[..., 3] > 0.0
    return np.ascontiguousarray(extend_nearest(coc, covered)[box.slices_in(whole)])
