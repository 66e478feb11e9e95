"""Foreground occlusion: coverage by real things in front of the object, and their own light.

Coverage comes from a depth map or from the plate's CoC. A depth map is sharp and the plate is not:
the mask of what is nearer than the object is spread over the CoC that the lens gives its depth.

Matting: where a blurred foreground covers a share m of a pixel, the plate shows
P = m F + (1 - m) B. With a layer of premultiplied light C and coverage a between the two it would
show m F + (1 - m) (C + (1 - a) B): the layer counts (1 - m) times and hides light of the background
B alone. So m F has to be separated from B in the soft edge; otherwise the old background remains
visible there as a halo.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.color import luma
from nlens_video.core.layers import Bool, Box, CocMap, DepthMap, Float32, ObjectLayer, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.occlusion_cues import MovingMatte
from nlens_video.kernels.channels import scaled_pixels
from nlens_video.kernels.coc_discontinuities import extend_nearest
from nlens_video.kernels.depth_layers import inpaint
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.stages.composite import Foreground, ForegroundMatte
from nlens_video.stages.l_reblur import ScatterKernel

CONTEXT_PX = 48  # margin around a region from which foreground and background are extended [px]
NEARER = 0.02
"""Share of the object's distance by which a depth must be nearer: the ground that it stands on is
as far as its feet [1]."""
_PURE = 1e-3  # a share this near to 0 or 1 is one of the two alone
_LUMA = luma("bt709").astype(np.float32)
_SMOOTHEST = 1e-4  # variance of display codes below which a picture has no edge
_LEFT_BEYOND, _FULL = 0.45, 0.95
_SOFTEST_PX = 1.0  # least blur of an edge: a depth map has no antialiasing [px]


def foreground_light(plate: Float32, coverage: Float32, corner: tuple[int, int]) -> Float32:
    """The foreground's share m F of a plate P = m F + (1 - m) B.

    F and B are inpainted into the soft edge from where each is seen alone (pull-push), then changed
    by the least amount that makes them add up to the plate. If one is nowhere seen alone, the other
    one decides.

    Args:
        plate: scene-linear light (h, w, 3).
        coverage: m (h, w), 0 to 1 [1].
        corner: row and column of the first pixel in the frame.

    Returns:
        Premultiplied light (h, w, 3), between 0 and the plate.
    """
    front, back = coverage >= 1.0 - _PURE, coverage <= _PURE
    free = np.float32(1.0) - coverage
    if not back.any():
        return scaled_pixels(plate, coverage)
    rest = scaled_pixels(inpainted(plate, back, corner), free)
    if front.any():
        own = scaled_pixels(inpainted(plate, front, corner), coverage)
        of_own = coverage * coverage / (coverage * coverage + free * free)
        light = own + scaled_pixels(plate - own - rest, of_own)
    else:
        light = plate - rest
    light[coverage <= 0.0] = 0.0
    return np.clip(light, 0.0, np.maximum(plate, 0.0), out=light)


def inpainted(plate: Float32, known: Bool, corner: tuple[int, int]) -> Float32:
    """A plate (h, w, 3) continued by pull-push from where it is known.

    Args:
        plate: scene-linear light (h, w, 3).
        known: where it is kept (h, w); somewhere at least.
        corner: row and column of the first pixel in the frame.
    """
    maps = cv2.cvtColor(np.ascontiguousarray(plate, np.float32), cv2.COLOR_RGB2RGBA)
    maps = cv2.copyTo(maps, known.view(np.uint8))
    filled = inpaint(np.asarray(maps, np.float32), known, corner)
    weight = np.maximum(filled[..., 3], np.float32(1e-6))
    out = np.empty(plate.shape, np.float32)
    for channel in range(3):  # NumPy is slow along an axis of three
        np.divide(filled[..., channel], weight, out=out[..., channel])
    return out


def foreground_matte(picture: Picture, region: Box, coverage: Float32) -> ForegroundMatte | None:
    """Foreground matte of a region, with its light separated from the background's.

    Args:
        picture: the plate as decoded.
        region: where layers will be composited; inside the frame.
        coverage: of the foreground on the whole frame (H, W) [1].

    Returns:
        The matte; None where nothing is in front there.
    """
    frame = Box(0, 0, picture.width, picture.height)
    seen = coverage[region.slices_in(frame)]
    if region.empty or not (seen > 0.0).any():
        return None
    wide = region.expanded(CONTEXT_PX).intersection(frame)
    light = foreground_light(
        picture.linear(wide), coverage[wide.slices_in(frame)], (wide.y0, wide.x0)
    )
    return ForegroundMatte(box=region, coverage=seen, light=light[region.slices_in(wide)])


def moving_mattes(picture: Picture, moving: MovingMatte) -> Foreground:
    """Mattes of things that move before a known background.

    All of them hide the ground that they stand on; those that are nearer hide the object.

    Args:
        picture: the plate as decoded.
        moving: what moves on a region.
    """
    light = picture.linear(moving.box)
    own = light - scaled_pixels(moving.background, np.float32(1.0) - moving.coverage)
    np.clip(own, 0.0, np.maximum(light, 0.0), out=own)
    own[moving.coverage <= 0.0] = 0.0
    over_ground = ForegroundMatte(box=moving.box, coverage=moving.coverage, light=own)
    return Foreground(
        before_object=ForegroundMatte(
            box=moving.box,
            coverage=moving.coverage * moving.before,
            light=scaled_pixels(own, moving.before),
        ),
        before_ground=over_ground,
        before_shadow=over_ground,
    )


def object_disparity(layer: ObjectLayer, frame: Box) -> Float32:
    """Disparity of the object on the frame (H, W), extended outwards from its silhouette.

    All 0 where it has no depth on the frame: then everything is nearer.
    """
    disparity = np.zeros((frame.height, frame.width), np.float32)
    common = layer.box.intersection(frame)
    if not common.empty:
        inside = common.slices_in(layer.box)
        depth = layer.depth[inside]
        known = (layer.rgba[inside][..., 3] > 0.0) & np.isfinite(depth) & (depth > 0.0)
        np.divide(1.0, depth, out=disparity[common.slices_in(frame)], where=known)
    return extend_nearest(disparity, disparity > 0.0)


class CoverageFromDepth(Struct, frozen=True, kw_only=True):
    """Coverage by nearer things of a depth map.

    Attributes:
        scatter: as of `ReblurLayer`.
        pixel_aspect: width of a pixel by its height [1].
    """

    scatter: ScatterKernel
    pixel_aspect: float = 1.0

    def __call__(
        self, real: DepthMap, disparity: Float32, region: Box, fit: LensFit | None
    ) -> Float32:
        """Coverage of the frame by what is nearer than a surface.

        Args:
            real: depth of the plate's things (H, W).
            disparity: of the surface (H, W) [1 / scene unit]; where it is not above 0, nothing
                is nearer.
            region: the pixels that count; inside the frame.
            fit: the lens; None leaves edges one pixel wide.

        Returns:
            Share of each pixel (H, W), 0 outside the region [1].
        """
        near = (real.depth * disparity < 1.0 - NEARER) & (disparity > 0.0)
        coc = np.zeros(near.shape, np.float32)
        if fit is not None:
            coc = fit.coc_px(np.where(near, 1.0 / real.depth, np.float32(0.0)))
        softest = np.float32(_SOFTEST_PX)
        coc = np.where(np.abs(coc) < softest, np.copysign(softest, coc), coc)
        return self.spread(near, coc, region)

    def spread(self, near: Bool, coc_px: Float32, region: Box) -> Float32:
        """A sharp mask (H, W) spread over its own CoC [px], on a region of the frame."""
        out = np.zeros(near.shape, np.float32)
        if region.empty or not near.any():
            return out
        largest = float(np.abs(coc_px[near]).max()) * max(1.0, self.pixel_aspect)
        reach = math.ceil(min(0.5 * largest, furthest_reach(self.pixel_aspect))) + 4
        frame = Box(0, 0, near.shape[1], near.shape[0])
        wide = region.expanded(reach)
        inside = wide.intersection(frame)
        # beyond the border of the frame the mask is extended
        beyond = (
            (inside.y0 - wide.y0, wide.y1 - inside.y1),
            (inside.x0 - wide.x0, wide.x1 - inside.x1),
        )
        mask = np.pad(near[inside.slices_in(frame)], beyond, mode="edge")
        coc = np.pad(coc_px[inside.slices_in(frame)], beyond, mode="edge")
        rgba = np.zeros((*mask.shape, 4), np.float32)
        rgba[..., 3] = mask
        seen = frame.translated(-wide.x0, -wide.y0)
        blurred = self.scatter(rgba, coc, pixel_aspect=self.pixel_aspect, frame=seen)
        out[region.slices_in(frame)] = blurred[region.slices_in(wide)][..., 3]
        return np.minimum(out, np.float32(1.0))


class CoverageFromCoc(Struct, frozen=True, kw_only=True):
    """Coverage by things that are certainly nearer by the plate's CoC.

    The CoC has no sign: a pixel may lie before the focus or behind it. It counts as nearer when
    both solutions agree: when the farther one is still nearer than the object, or lies beyond
    infinity.

    Attributes:
        sigmas: least difference of the CoC, in expected errors of the estimate [1].
        least_px: least difference of the CoC [px].
        share: least difference of the CoC, by the lens' CoC at infinity [1].
        edge_px: radius around a coarse edge in which the plate's edge is searched [px].
    """

    sigmas: float = 4.0
    least_px: float = 1.5
    share: float = 0.1
    edge_px: int = 12

    def __call__(
        self, plate: CocMap, disparity: Float32, region: Box, fit: LensFit, picture: Float32
    ) -> Float32:
        """Coverage of the frame by things that are certainly nearer than a surface.

        Args:
            plate: unsigned CoC of the plate and its expected error (H, W) [px].
            disparity: of the surface (H, W) [1 / scene unit].
            region: the pixels that count; inside the frame.
            fit: the lens.
            picture: the plate, display-coded (H, W, 3), whose edges the coverage follows.

        Returns:
            Share of each pixel (H, W), 0 outside the region [1].
        """
        near = self.nearer(plate, disparity, fit)
        out = np.zeros(near.shape, np.float32)
        if region.empty or not near.any():
            return out
        frame = Box(0, 0, near.shape[1], near.shape[0])
        wide = region.expanded(4 * self.edge_px).intersection(frame)
        at = wide.slices_in(frame)
        soft = _along_edges(near[at], picture[at], self.edge_px)
        out[region.slices_in(frame)] = soft[region.slices_in(wide)]
        return out

    def nearer(self, plate: CocMap, disparity: Float32, fit: LensFit) -> Bool:
        """Where (H, W) the plate is nearer than a surface, whatever the sign of its CoC."""
        surface = fit.coc_px(disparity)
        margin = np.maximum(self.sigmas * plate.sigma_px, np.float32(self.least_px))
        margin = np.maximum(margin, np.float32(self.share * abs(min(fit.intercept, 0.0))))
        least, most = plate.coc_px - margin, plate.coc_px + margin  # of the CoC without sign
        before_focus = np.maximum(least, np.float32(0.0)) > surface
        behind_focus = (-most > surface) | (least > -fit.intercept)  # nearer, or beyond infinity
        return np.asarray(before_focus & behind_focus & (disparity > 0.0))


def _along_edges(near: Bool, picture: Float32, radius: int) -> Float32:
    """A coarse mask aligned to the edges of a picture (guided filter, He et al. 2013)."""
    # by luma: for a picture of one hue OpenCV's filter with three channels is not accurate
    guide = np.ascontiguousarray(picture @ _LUMA, dtype=np.float32)
    side = radius // 2 + 1
    speck = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    kept = cv2.morphologyEx(near.astype(np.uint8), cv2.MORPH_OPEN, speck)
    soft = cv2.ximgproc.guidedFilter(guide, kept.astype(np.float32), radius, _SMOOTHEST)
    # a CoC estimate reaches across a sharp edge by part of its window: a share below a half
    stretched = (np.asarray(soft) - _LEFT_BEYOND) / (_FULL - _LEFT_BEYOND)
    return np.asarray(np.clip(stretched, 0.0, 1.0), dtype=np.float32)
