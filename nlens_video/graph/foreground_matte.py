"""The matte of what moves on a frame, from the shot's background and the order of its things."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Box, Float32, Float64, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.foreground.background import Background, SmallBackground, gain, root
from nlens_video.effects.foreground.canvas import Canvas
from nlens_video.effects.foreground.looks import parted
from nlens_video.effects.foreground.matte import soft_matte
from nlens_video.effects.foreground.things import find_regions, things_mask
from nlens_video.effects.foreground.tracks import Ordered
from nlens_video.effects.occlusion_cues import MovingMatte, MovingThings, SeenBackground
from nlens_video.scene.camera import Camera

_ALONG = 2.0  # pixels of the small size, within which the border of things that meet is sought
_SMOOTHEST = 2e-4  # variance of roots of light below which it is no border
_CONTEXT_PX = 24  # around a region from which a thing is continued [px]
_UNKNOWN_NOISE = 1.0 / 255.0  # of a root of light, where nothing tells it


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingForeground:
    """What moves in a shot around its object.

    Attributes:
        canvas: where the frames are laid.
        small: background of the whole canvas at a small size.
        background: that of the object's surroundings.
        things: what moves on each frame.
        cameras: that of each frame.
    """

    canvas: Canvas
    small: SmallBackground
    background: Background
    things: Mapping[int, tuple[Ordered, ...]]
    cameras: Mapping[int, Camera]

    def on_frame(self, index: int) -> MovingThings:
        """What moves on a frame."""
        things = self.things.get(index, ())

        def matte(picture: Picture, region: Box, fit: LensFit | None) -> MovingMatte | None:
            return (
                self._matte(things, self.cameras[index], picture, region, fit) if things else None
            )

        def background(picture: Picture) -> SeenBackground:
            return self._seen(picture, self.cameras[index])

        return MovingThings(matte, self._feet(things, index), background)

    def _seen(self, picture: Picture, camera: Camera) -> SeenBackground:
        """The background around the object, where nothing but shadows moves."""
        canvas, held = self.canvas, self.background.box
        box = canvas.seen(held, camera)
        roots, small = canvas.small(picture, camera), canvas.background(self.small, camera)
        mask = things_mask(small.normalised(roots), small.roots, small.noise)
        wide = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
        change = gain(roots, small.roots)
        light = np.square(canvas.from_part(self.background.roots, held, camera, box) * change)
        light[canvas.from_small(wide, camera, box) > 0.0] = np.nan
        return SeenBackground(box=box, light=light)

    def _feet(self, things: tuple[Ordered, ...], index: int) -> Float64:
        """Where things stand in the frame (N, 2) [px]."""
        scale = self.canvas.size[0] / self.canvas.small_size[0]
        found = []
        for one in things:
            edges = (one.box.x0, one.box.y0, one.box.x1, one.box.y1)
            wide = Box(*(round(scale * edge) for edge in edges))
            seen = self.canvas.seen(wide, self.cameras[index])
            found.append((0.5 * (seen.x0 + seen.x1), float(seen.y1)))
        return np.array(found).reshape(-1, 2)

    def _matte(
        self, things: tuple[Ordered, ...], camera: Camera, picture: Picture, region: Box,
        fit: LensFit | None,
    ) -> MovingMatte | None:  # fmt: skip
        canvas, held = self.canvas, self.background.box
        known = canvas.seen(held, camera)
        box = region.intersection(known)
        if box.empty:
            return None
        small_box = self.small.small(canvas.reached(box, camera))
        if all(one.box.intersection(small_box).empty for one in things):
            return None
        roots, small = canvas.small(picture, camera), canvas.background(self.small, camera)
        near, before, meet = _things_near(things, small.normalised(roots), small)
        wide = box.expanded(_CONTEXT_PX).intersection(known)
        prior = canvas.from_small(near, camera, wide) > 0.5
        if not prior.any():
            return None
        light = picture.linear(wide)
        change = gain(roots, small.roots)
        below = np.square(canvas.from_part(self.background.roots, held, camera, wide) * change)
        noise = canvas.from_part(self.background.noise, held, camera, wide)
        unknown = np.isnan(below[..., 0]) | np.isnan(noise)
        if unknown.any():
            below[unknown], noise = light[unknown], np.nan_to_num(noise, nan=_UNKNOWN_NOISE)
        scale = canvas.size[0] / canvas.small_size[0]
        edge_px = self._edge_px(things, fit, scale)
        share = soft_matte(light, below, noise, prior, edge_px, scale)
        share[unknown] = 0.0
        order = canvas.from_small(before, camera, wide)
        if meet:  # where one ends and another begins the picture knows better
            guide = np.ascontiguousarray(root(light))
            reach = max(2, math.ceil(_ALONG * scale))
            order = np.clip(cv2.ximgproc.guidedFilter(guide, order, reach, _SMOOTHEST), 0.0, 1.0)
        cut = box.slices_in(wide)
        return MovingMatte(
            box=box, coverage=share[cut], before=np.asarray(order[cut], np.float32),
            background=below[cut],
        )  # fmt: skip

    def _edge_px(self, things: tuple[Ordered, ...], fit: LensFit | None, scale: float) -> float:
        """How wide the softest edge of a thing is, by lens and motion [px]."""
        widest = 0.0
        for one in things:
            disparity = np.array([one.disparity], np.float32)
            coc = 0.0 if fit is None else abs(float(fit.coc_px(disparity)[0]))
            widest = max(widest, coc + 0.5 * one.moved_px * scale)
        return min(max(0.75 * widest, 1.0) + 1.0, 40.0)


def _things_near(
    things: tuple[Ordered, ...], roots: Float32, small: SmallBackground
) -> tuple[Float32, Float32, bool]:
    """Mask of what moves, how much of it is before the object, at the small size (h, w).

    And whether things of different order meet.
    """
    mask = things_mask(roots, small.roots, small.noise)
    meet = False
    near, order = np.zeros(mask.shape, np.float32), np.full(mask.shape, np.nan, np.float32)
    frame = Box(0, 0, *mask.shape[::-1])
    for region in find_regions(mask):
        parts = sorted(
            (one for one in things if one.region == region.box), key=lambda one: one.disparity
        )
        inside = np.zeros(mask.shape, np.bool_)
        inside[region.box.slices_in(frame)] = region.inside
        near[inside] = bool(parts)
        if len({one.before for one in parts}) > 1:
            meet, at = True, region.box.slices_in(frame)
            shares = parted(
                [one.look for one in parts], [one.box for one in parts], roots[at], region.box
            )
            mixed = np.tensordot(np.array([one.before for one in parts], np.float32), shares, 1)
            order[at][inside[at]] = mixed[inside[at]]
            continue
        for one in parts:  # the nearest last
            at = one.box.intersection(frame).slices_in(frame)
            order[at][inside[at]] = one.before
    _, nearest = cv2.distanceTransformWithLabels(
        np.isnan(order).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    known = ~np.isnan(order)
    values = np.zeros(int(nearest.max()) + 1, np.float32)
    values[nearest[known]] = order[known]
    return near, values[nearest], meet
