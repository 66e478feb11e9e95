"""The shadow as a layer on the ground: its grid, and the composite over the plate.

The lens blurs the loss of light as it blurs the ground there; the paper leaves that open.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import (  # fmt: skip
    BlurredLayer,
    Box,
    DefocusedLayer,
    Float32,
    ObjectLayer,
    Picture,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.channels import channel_sum, scaled_pixels
from nlens_video.kernels.scatter.plane_blur import LARGEST_COC_PX, WIDEST_PX, PlaneCoc, blur_plane
from nlens_video.scene.camera import Camera
from nlens_video.stages.composite import ForegroundMatte
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, ReblurLayer

_MEAN_WITHOUT = np.hstack([np.diag([-1, -1, -1, 0]), np.ones((4, 1))])[:, [0, 1, 2, 4]].astype(
    np.float32
)
_WITH_MEAN = np.vstack([np.eye(3), np.full((1, 3), 1.0 / 3.0)]).astype(np.float32)


class Grid(Struct, frozen=True, kw_only=True, eq=False):
    """Sample positions on the ground: pixels of a box of the frame, perhaps coarser ones.

    Attributes:
        box: where they lie; borders are multiples of the step, so that all boxes share one grid
            [px].
        step: pixels of the frame that each stands for, each way [px].
    """

    box: Box
    step: int

    @classmethod
    def on(cls, box: Box, step: int) -> Grid:
        """The grid that holds a box of a frame."""
        low = Box(box.x0 // step, box.y0 // step, -(-box.x1 // step), -(-box.y1 // step))
        return cls(box=scaled(low, step), step=step)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.box.height // self.step, self.box.width // self.step

    def view(self, camera: Camera) -> Camera:
        """A camera of the frame, with the grid as its pixels."""
        step, (height, width) = self.step, self.shape
        return replace(
            camera,
            fx=camera.fx / step, fy=camera.fy / step,
            cx=(camera.cx - self.box.x0) / step, cy=(camera.cy - self.box.y0) / step,
            width=width, height=height,
        )  # fmt: skip


class Shade(Struct, frozen=True, eq=False):
    """A shadow where something else hides the sun from the ground.

    Attributes:
        shadow: what the object blocks of the other light; None for nothing.
        left: share of the ground's light that is left there, in [0, 1) [1].
    """

    shadow: Shadow | None
    left: float


class Shadow(Struct, frozen=True, kw_only=True, eq=False):
    """The share of the ground's light that the object blocks.

    Attributes:
        box: where the arrays lie in the frame; may reach beyond it.
        loss: share of the light that is lost (h, w, 3), 0 outside the shadow [1].
        coc_px: signed CoC diameter of the ground (h, w), 0 where the lens is not known [px of the
            frame].
        step: pixels of the frame that each pixel of the arrays stands for, each way [px].
        on_things: whether it falls on filmed things by their depth, not on the plane alone; the
            CoC is theirs, then.
        shade: finds what it is where something else hides the sun, if one is known; None where
            nothing is looked for that does.
    """

    box: Box
    loss: Float32
    coc_px: Float32
    step: int = 1
    on_things: bool = False
    shade: Callable[[], Shade | None] | None = None

    def __post_init__(self) -> None:
        size = self.box.height // self.step, self.box.width // self.step
        if self.loss.shape != (*size, 3) or self.coc_px.shape != size:
            raise ValueError(f"{self.loss.shape = }, {self.coc_px.shape = }, {size} in {self.box}")

    @property
    def fine(self) -> Shadow:
        """The same on the frame's own pixels."""
        if self.step == 1:
            return self
        size = self.box.width, self.box.height
        coc: Float32 = np.asarray(cv2.resize(self.coc_px, size), dtype=np.float32)
        loss = enlarged(self.loss, self.step)
        return replace(self, loss=loss, coc_px=coc, step=1)


def pixels_of(box: Box, step: int) -> Box:
    """A box of the frame in pixels of a coarser grid, whose border it lies on."""
    return Box(box.x0 // step, box.y0 // step, box.x1 // step, box.y1 // step)


def scaled(box: Box, step: int) -> Box:
    """A box of a coarser grid in pixels of the frame."""
    return Box(box.x0 * step, box.y0 * step, box.x1 * step, box.y1 * step)


def enlarged(values: Float32, step: int) -> Float32:
    """Shares (h, w) or (h, w, c) on pixels so many times smaller, between 0 and 1."""
    height, width = values.shape[:2]
    size = (width * step, height * step)
    fine = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_CUBIC), dtype=np.float32)
    return np.clip(fine, np.float32(0.0), np.float32(1.0), out=fine)


def ground_blur(
    camera: Camera, ground_y: float, box: Box, fit: LensFit | None
) -> tuple[float, float]:
    """Least and greatest CoC diameter of the ground in a box of the frame [px].

    The CoC is affine there, up to the horizon.
    """
    if fit is None or box.empty:
        return 0.0, 0.0
    corners = Grid.on(box, 1).view(camera).corner_disparity(ground_y)
    coc = fit.coc_px(np.maximum(corners, 0.0).astype(np.float32))
    crosses = coc.min() <= 0.0 <= coc.max()
    return 0.0 if crosses else float(np.abs(coc).min()), float(np.abs(coc).max())


class BlurredShadow(Struct, frozen=True, kw_only=True, eq=False, dict=True):
    """A shadow as the lens shows it.

    Attributes:
        box: where the array lies; inside the frame.
        loss: share of the light that is lost in each channel, and its mean (h, w, 4) [1].
    """

    box: Box
    loss: Float32

    @cached_property
    def darkening(self) -> BlurredLayer:
        """What darkens the plate, as a layer whose colours are multiples of the plate's light."""
        if self.box.empty or not self.loss.any():
            return BlurredLayer.nothing()
        return BlurredLayer(box=self.box, rgba=_darkening(self.loss))

    def mixed(self, other: BlurredShadow | None, box: Box, part: Float32) -> BlurredShadow:
        """This shadow and another where only a part of the ground is as this one takes it.

        Args:
            other: on the rest of the ground; None for no shadow.
            box: where the part is known; inside the frame, beyond it this shadow stays.
            part: (h, w) [1].
        """
        whole = self.box if other is None else self.box.union(other.box)
        if (common := box.intersection(whole)).empty:
            return self
        mixed, rest = (np.zeros((whole.height, whole.width, 4), np.float32) for _ in range(2))
        mixed[self.box.slices_in(whole)] = self.loss
        if other is not None:
            rest[other.box.slices_in(whole)] = other.loss
        share, at = part[common.slices_in(box)], common.slices_in(whole)
        mixed[at] = scaled_pixels(mixed[at], share)
        mixed[at] += scaled_pixels(rest[at], np.float32(1.0) - share)
        return BlurredShadow(box=whole, loss=mixed)


def _darkening(loss: Float32) -> Float32:
    """Over has one alpha for all channels: the loss less its mean is added as colour."""
    return np.asarray(cv2.transform(loss, _MEAN_WITHOUT), dtype=np.float32)


class ApplyShadow(Struct, frozen=True):
    """Composites a shadow over the plate, blurred as the lens blurs the ground.

    Attributes:
        blur: the lens.
        round_lens: whether its discs are round all over the frame: a shadow on the plane alone is
            then blurred as a plane, which is quicker.
    """

    blur: ReblurLayer
    round_lens: bool = False

    def __call__(
        self, picture: Picture, shadow: Shadow, frame: Box, matte: ForegroundMatte | None = None
    ) -> Picture:
        """Multiply the plate in place by the light that remains; returns the picture.

        Args:
            picture: the plate; changed where the blurred shadow reaches, and only there.
            shadow: the loss of light.
            frame: the frame's own box.
            matte: of things in front of the ground.
        """
        return multiply(picture, behind_foreground(self.blurred(shadow, frame), picture, matte))

    def blurred(self, shadow: Shadow, frame: Box) -> BlurredShadow:
        """The shadow as the lens shows it."""
        found = BlurredLayer.nothing() if shadow.box.empty else self._blurred(shadow, frame)
        return BlurredShadow(box=found.box, loss=found.rgba)

    def _blurred(self, shadow: Shadow, frame: Box) -> BlurredLayer:
        """Loss in each channel and its mean, on a box inside the frame."""
        if (step := shadow.step) == 1:
            return self._on_grid(shadow, frame)
        blurred = self._on_grid(shadow, Box(0, 0, -(-frame.x1 // step), -(-frame.y1 // step)))
        if blurred.box.empty:  # beside the frame
            return blurred
        wide = scaled(blurred.box, step)
        box = wide.intersection(frame)
        rgba = enlarged(blurred.rgba, step)[box.slices_in(wide)]
        return BlurredLayer(box=box, rgba=np.ascontiguousarray(rgba))

    def _on_grid(self, shadow: Shadow, frame: Box) -> BlurredLayer:
        """The same in pixels of the shadow's grid, as `frame` is."""
        box = pixels_of(shadow.box, shadow.step)
        coc = shadow.coc_px if shadow.step == 1 else shadow.coc_px / np.float32(shadow.step)
        on_plane = self.round_lens and not shadow.on_things and coc.size > 0
        plane = PlaneCoc.of(coc) if on_plane and box.width < WIDEST_PX else None
        largest = 0.0 if plane is None else plane.largest_px(box.width, box.height)
        if plane is not None and NEGLIGIBLE_COC_PX <= largest <= LARGEST_COC_PX:
            aspect = self.blur.pixel_aspect
            margin = math.ceil(0.5 * largest * max(1.0, aspect)) + 1
            target = box.expanded(margin).intersection(frame)
            if target.empty:
                return BlurredLayer.nothing()
            there = target.translated(-box.x0, -box.y0)
            return BlurredLayer(box=target, rgba=blur_plane(shadow.loss, plane, there, aspect))
        rgba: Float32 = np.asarray(cv2.transform(shadow.loss, _WITH_MEAN), dtype=np.float32)
        layer = ObjectLayer(box=box, rgba=rgba, depth=np.ones(rgba.shape[:2], np.float32))
        return self.blur(DefocusedLayer(layer=layer, coc_px=coc), frame)


def behind_foreground(
    blurred: BlurredShadow, picture: Picture, matte: ForegroundMatte | None
) -> BlurredLayer:
    """What darkens the plate behind a foreground, as a layer of multiples of the plate's light.

    Args:
        blurred: the shadow.
        picture: the plate; unchanged.
        matte: of things in front of the ground.
    """
    layer = blurred.darkening
    if matte is None or layer.box.empty:
        return layer
    return BlurredLayer(box=layer.box, rgba=_darkening(_behind(blurred, picture, matte)))


def multiply(picture: Picture, darkening: BlurredLayer) -> Picture:
    """Composite a layer of multiples of the plate's light in place; returns the picture."""
    if not darkening.box.empty:
        picture.composite_over(darkening.box, darkening.rgba, of_plate=True)
    return picture


def _behind(blurred: BlurredShadow, picture: Picture, matte: ForegroundMatte) -> Float32:
    """Loss and its mean (h, w, 4), of the light that does not come from the foreground."""
    common = blurred.box.intersection(matte.box)
    if common.empty:
        return blurred.loss
    plate, at = picture.linear(common), common.slices_in(matte.box)
    rest = plate - matte.light[at]
    share = np.divide(rest, plate, out=np.ones_like(plate), where=plate > 0.0)
    share[matte.coverage[at] >= 1.0] = 0.0
    loss = blurred.loss.copy()
    loss[common.slices_in(blurred.box)][..., :3] *= np.clip(share, 0.0, 1.0)
    loss[..., 3] = channel_sum(loss) / np.float32(3.0)
    return loss
