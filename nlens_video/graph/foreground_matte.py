"""Matte of the moving targets on a frame, from the shot's background and their depth order."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, Float32, Float64, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.foreground.appearance import segment
from nlens_video.effects.foreground.background import (
    BackgroundModel,
    CleanPlate,
    exposure_gain,
    sqrt_light,
    tells_nothing,
)
from nlens_video.effects.foreground.detection import find_blobs, foreground_mask
from nlens_video.effects.foreground.matte import soft_matte
from nlens_video.effects.foreground.reference_view import ReferenceView
from nlens_video.effects.foreground.tracker import TrackState
from nlens_video.effects.occlusion_cues import MovingMatte, MovingThings, SeenBackground
from nlens_video.kernels.channels import scaled_channels
from nlens_video.scene.camera import Camera

_GUIDE_RADIUS_PX = 2.0  # radius of the guided filter of the border in a merged blob [lowres px]
_GUIDE_EPSILON = 2e-4  # its regularisation: variance of roots of light within a target [1]
_CONTEXT_PX = 24  # around a region, from which the foreground is extrapolated [px]
_UNKNOWN_NOISE = 1.0 / 255.0  # standard deviation of a root of light where it is not known [1]


class _LowresFrame(Struct, frozen=True, kw_only=True):
    """A frame at low resolution beside the background.

    Attributes:
        gain: ratio of its roots of light to those of the background (3,) [1].
        roots: square root of its light (h, w, 3), in the background's exposure if it has a mask.
        mask: its foreground mask (h, w); None where it is too dark or lit by a flash.
    """

    gain: Float32
    roots: Float32
    mask: Bool | None


class MovingForeground(Struct, frozen=True, kw_only=True):
    """What moves in a shot around its object.

    Attributes:
        reference: the reference view of the shot.
        model: background of the whole view at low resolution.
        clean_plate: background of the object's surroundings at full resolution.
        states: the targets on each frame, by its number.
        cameras: the camera of each of these frames.
    """

    reference: ReferenceView
    model: BackgroundModel
    clean_plate: CleanPlate
    states: Mapping[int, tuple[TrackState, ...]]
    cameras: Mapping[int, Camera]

    def on_frame(self, index: int) -> MovingThings:
        """What moves on a frame."""
        states = self.states.get(index, ())
        made: list[_LowresFrame] = []

        def lowres(picture: Picture) -> _LowresFrame:
            """This frame's, made once."""
            if not made:
                made.append(self._lowres(picture, self.cameras[index]))
            return made[0]

        def matte(picture: Picture, region: Box, fit: LensFit | None) -> MovingMatte | None:
            if not states:
                return None
            return self._matte(states, self.cameras[index], picture, region, fit, lowres)

        def background(picture: Picture) -> SeenBackground:
            return self._background(lowres(picture), self.cameras[index])

        return MovingThings(matte, self._feet(states, index), background)

    def _lowres(self, picture: Picture, camera: Camera) -> _LowresFrame:
        roots = self.reference.warp_lowres(picture, camera)
        model = self.reference.render_background(self.model, camera)
        gain = exposure_gain(roots, model.roots)
        if tells_nothing(roots, model.roots):
            return _LowresFrame(gain=gain, roots=roots, mask=None)
        roots = model.normalised(roots, gain)
        mask = foreground_mask(roots, model.roots, model.noise)
        return _LowresFrame(gain=gain, roots=roots, mask=mask)

    def _background(self, lowres: _LowresFrame, camera: Camera) -> SeenBackground:
        """The background around the object, where at most shadows move."""
        reference, source = self.reference, self.clean_plate.box
        box = reference.box_in_frame(source, camera)
        if lowres.mask is None:
            return SeenBackground(
                box=box, light=np.full((box.height, box.width, 3), np.nan, np.float32)
            )
        wide = cv2.dilate(lowres.mask.astype(np.uint8), np.ones((3, 3), np.uint8))
        roots = reference.box_to_frame(self.clean_plate.roots, source, camera, box)
        light = np.square(scaled_channels(roots, lowres.gain))
        light[reference.lowres_to_frame(wide.astype(np.float32), camera, box) > 0.0] = np.nan
        return SeenBackground(box=box, light=light)

    def _feet(self, states: tuple[TrackState, ...], index: int) -> Float64:
        """Where targets stand in the frame (N, 2) [px]."""
        scale = self.reference.size[0] / self.reference.lowres_size[0]
        found = []
        for one in states:
            edges = (one.box.x0, one.box.y0, one.box.x1, one.box.y1)
            full = Box(*(round(scale * edge) for edge in edges))
            box = self.reference.box_in_frame(full, self.cameras[index])
            found.append((0.5 * (box.x0 + box.x1), float(box.y1)))
        return np.array(found).reshape(-1, 2)

    def _matte(
        self, states: tuple[TrackState, ...], camera: Camera, picture: Picture, region: Box,
        fit: LensFit | None, lowres: Callable[[Picture], _LowresFrame],
    ) -> MovingMatte | None:  # fmt: skip
        reference, source = self.reference, self.clean_plate.box
        known = reference.box_in_frame(source, camera)
        box = region.intersection(known)
        if box.empty:
            return None
        lowres_box = self.model.lowres_box(reference.box_in_reference(box, camera))
        if all(one.box.intersection(lowres_box).empty for one in states):
            return None
        seen = lowres(picture)
        if seen.mask is None:  # the targets are where they are expected
            near, order = (
                reference.lowres_to_frame(one, camera, box)
                for one in _silhouettes(states, seen.roots.shape[:2])
            )
            return MovingMatte(box=box, coverage=near, before=order, background=picture.linear(box))
        near, in_front, mixed = _lowres_order(states, seen.roots, seen.mask)
        wide = box.expanded(_CONTEXT_PX).intersection(known)
        prior = reference.lowres_to_frame(near, camera, wide) > 0.5
        if not prior.any():
            return None
        light = picture.linear(wide)
        below = reference.box_to_frame(self.clean_plate.roots, source, camera, wide)
        below = np.square(scaled_channels(below, seen.gain))
        noise = reference.box_to_frame(self.clean_plate.noise, source, camera, wide)
        unknown = np.isnan(below[..., 0]) | np.isnan(noise)
        if unknown.any():
            below[unknown], noise = light[unknown], np.nan_to_num(noise, nan=_UNKNOWN_NOISE)
        scale = reference.size[0] / reference.lowres_size[0]
        edge_px = self._edge_px(states, fit, scale)
        share = soft_matte(light, below, noise, prior, edge_px, scale)
        share[unknown] = 0.0
        covered = Box.of(share > 0.0).translated(wide.x0, wide.y0).intersection(box)
        if covered.empty:
            return None
        order = reference.lowres_to_frame(in_front, camera, wide)
        if mixed:  # align the border between the targets with edges of the picture
            radius = max(2, math.ceil(_GUIDE_RADIUS_PX * scale))
            part = covered.expanded(2 * radius).intersection(wide).slices_in(wide)
            guide = np.ascontiguousarray(sqrt_light(light[part]))
            filtered = cv2.ximgproc.guidedFilter(guide, order[part], radius, _GUIDE_EPSILON)
            order[part] = np.clip(filtered, 0.0, 1.0)
        crop = covered.slices_in(wide)
        return MovingMatte(
            box=covered, coverage=share[crop], before=np.asarray(order[crop], np.float32),
            background=below[crop],
        )  # fmt: skip

    def _edge_px(self, states: tuple[TrackState, ...], fit: LensFit | None, scale: float) -> float:
        """Width of the softest edge of a target, by the lens' and by motion blur [px]."""
        widest = 0.0
        for one in states:
            disparity = np.array([one.disparity], np.float32)
            coc = 0.0 if fit is None else abs(float(fit.coc_px(disparity)[0]))
            widest = max(widest, coc + 0.5 * one.displacement_px * scale)
        return min(max(0.75 * widest, 1.0) + 1.0, 40.0)


def _silhouettes(states: tuple[TrackState, ...], shape: tuple[int, ...]) -> tuple[Float32, Float32]:
    """Mask of targets (h, w) by their mean silhouettes at low resolution, and their depth order.

    Returns:
        The mask; 1 in front of the object to 0 behind it (h, w) [1], also just beside the mask.
    """
    near, order = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    whole = Box(0, 0, shape[1], shape[0])
    for one in sorted(states, key=lambda one: one.disparity):  # the nearest last
        inside = one.appearance.coverage(one.box, whole) > 0.5
        near[inside] = 1.0
        wide = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        order[wide] = one.in_front
    return near, order


def _lowres_order(
    states: tuple[TrackState, ...], roots: Float32, mask: Bool
) -> tuple[Float32, Float32, bool]:
    """Mask of tracked targets and their depth order at low resolution.

    Args:
        states: the targets on the frame.
        roots: square root of its light (h, w, 3), in the background's exposure.
        mask: its foreground mask (h, w).

    Returns:
        The mask (h, w); 1 in front of the object to 0 behind it (h, w) [1], outside the mask that
        of the nearest pixel; and whether targets of different order are merged.
    """
    mixed = False
    near, order = np.zeros(mask.shape, np.float32), np.full(mask.shape, np.nan, np.float32)
    frame = Box(0, 0, *mask.shape[::-1])
    for blob in find_blobs(mask):
        members = sorted(
            (one for one in states if one.blob_box == blob.box), key=lambda one: one.disparity
        )
        inside = np.zeros(mask.shape, np.bool_)
        inside[blob.box.slices_in(frame)] = blob.mask
        near[inside] = bool(members)
        if len({one.in_front for one in members}) > 1:
            mixed, crop = True, blob.box.slices_in(frame)
            shares = segment(
                [one.appearance for one in members], [one.box for one in members], roots[crop],
                blob.box,
            )  # fmt: skip
            in_front = np.array([one.in_front for one in members], np.float32)
            order[crop][inside[crop]] = np.tensordot(in_front, shares, 1)[inside[crop]]
            continue
        for one in members:  # the nearest last, over the others
            crop = one.box.intersection(frame).slices_in(frame)
            order[crop][inside[crop]] = one.in_front
    _, nearest = cv2.distanceTransformWithLabels(
        np.isnan(order).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    known = ~np.isnan(order)
    values = np.zeros(int(nearest.max()) + 1, np.float32)
    values[nearest[known]] = order[known]
    return near, values[nearest], mixed
