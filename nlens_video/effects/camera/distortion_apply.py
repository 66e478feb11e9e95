"""Applies the plate's lens distortion to the object, its shadow and its mirror image.

The GLB's camera is a pinhole. Its layers are warped after the blur: a circle of confusion keeps its
shape but for the lens' local magnification, a few hundredths. The ground's position in the plate is
that of the pinhole camera.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.box import half_diagonal, undistorted_radius
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    DepthMap,
    Float32,
    Float64,
    ObjectLayer,
)
from nlens_video.core.optics import Distortion
from nlens_video.effects.shadow.apply import Shade, Shadow
from nlens_video.scene.camera import Camera

MARGIN_LIMIT_PX = 512
_BAND = 64  # rows that are bounded at once: what that takes stays in the cache
_NOWHERE = -1e4  # a place that no layer covers [px]


class DistortionMap(Struct, frozen=True):
    """A distortion in the pixels of one camera.

    Attributes:
        model: the distortion.
        centre: of the distortion, column and row [px].
        unit: columns and rows of radius 1 [px].
        frame: the frame's own box.
    """

    model: Distortion
    centre: tuple[float, float]
    unit: tuple[float, float]
    frame: Box

    @classmethod
    def of(cls, model: Distortion, camera: Camera) -> DistortionMap:
        """The distortion as a camera's frame shows it."""
        frame = Box(0, 0, camera.width, camera.height)
        if model.focal_normalized:
            return cls(model, (camera.cx, camera.cy), (camera.fx, camera.fy), frame)
        half = half_diagonal(frame)
        return cls(model, (0.5 * frame.width, 0.5 * frame.height), (half, half), frame)

    def undistorted(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Ideal positions of distorted columns `x` and rows `y` [px]; NaN where there are none."""
        across, down = (x - self.centre[0]) / self.unit[0], (y - self.centre[1]) / self.unit[1]
        far = np.hypot(across, down)
        scale = undistorted_radius(self.model.k1, self.model.k2, far) / np.maximum(far, 1e-12)
        scale = np.where(np.isfinite(scale), scale, np.nan)
        scale[far < 1e-9] = 1.0
        return (
            across * scale * self.unit[0] + self.centre[0],
            down * scale * self.unit[1] + self.centre[1],
        )

    def distorted(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Distorted positions of ideal columns `x` and rows `y` [px]."""
        across, down = (x - self.centre[0]) / self.unit[0], (y - self.centre[1]) / self.unit[1]
        square = across**2 + down**2
        scale = 1.0 + self.model.k1 * square + self.model.k2 * square**2
        return (
            across * scale * self.unit[0] + self.centre[0],
            down * scale * self.unit[1] + self.centre[1],
        )

    @property
    def folds(self) -> bool:
        """Whether a part of the frame has no ideal position."""
        return bool(np.isnan(self.undistorted(*_outline(self.frame))[0]).any())

    @property
    def margin(self) -> int:
        """Overscan of the ideal camera that fills the distorted frame [px]."""
        x, y = _outline(self.frame)
        there = self.undistorted(x, y)
        beyond = [
            float(np.max(np.where(np.isfinite(part), np.maximum(-part, part - size), 0.0)))
            for part, size in zip(there, (self.frame.width, self.frame.height), strict=True)
        ]
        return math.ceil(min(max(0.0, *beyond), MARGIN_LIMIT_PX)) + (max(beyond) > 0.0)

    def reached(self, box: Box, beyond: int = 0) -> Box:
        """Bounds of the distorted pixels of an ideal box, up to `beyond` outside the frame [px]."""
        seen = box.intersection(self.frame.expanded(self.margin + beyond))
        if seen.empty:
            return Box(0, 0, 0, 0)
        x, y = _outline(seen)
        across, down = self.distorted(x, y)
        return Box(
            math.floor(across.min()) - 1,
            math.floor(down.min()) - 1,
            math.ceil(across.max()) + 1,
            math.ceil(down.max()) + 1,
        )

    def remap(self, box: Box, held: Box) -> tuple[Float32, Float32]:
        """Columns and rows in an array on `held` of the distorted pixels of `box` (h, w) [px]."""
        x, y = np.meshgrid(np.arange(box.x0, box.x1) + 0.5, np.arange(box.y0, box.y1) + 0.5)
        across, down = self.undistorted(x, y)
        known = np.isfinite(across) & np.isfinite(down)
        columns = np.where(known, across - held.x0 - 0.5, _NOWHERE)
        rows = np.where(known, down - held.y0 - 0.5, _NOWHERE)
        return columns.astype(np.float32), rows.astype(np.float32)


def distort(layer: BlurredLayer, warp: DistortionMap) -> BlurredLayer:
    """A blurred layer, which may reach beyond the frame, distorted and cut to the frame."""
    box = warp.reached(layer.box).intersection(warp.frame)
    if box.empty:
        return BlurredLayer.nothing()
    return BlurredLayer(box=box, rgba=_sharply_warped(layer.rgba, warp.remap(box, layer.box)))


def distort_shadow(shadow: Shadow, warp: DistortionMap) -> Shadow:
    """A distorted shadow."""
    shadow, found = shadow.fine, shadow.shade
    box = warp.reached(shadow.box, _reach(shadow.coc_px))
    places = warp.remap(box, shadow.box)
    return replace(
        shadow,
        box=box,
        loss=np.clip(_warped(shadow.loss, places, cv2.INTER_LINEAR), 0.0, 1.0),
        coc_px=_warped(shadow.coc_px, places, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE),
        shade=None if found is None else lambda: _distort_shade(found(), warp),
    )


def _distort_shade(shade: Shade | None, warp: DistortionMap) -> Shade | None:
    if shade is None or shade.shadow is None:
        return shade
    return replace(shade, shadow=distort_shadow(shade.shadow, warp))


def undistorted_depth(real: DepthMap, warp: DistortionMap) -> DepthMap:
    """Depth of a distorted frame as the pinhole sees it; unknown beyond the frame."""
    frame = warp.frame
    x, y = np.meshgrid(np.arange(frame.width) + 0.5, np.arange(frame.height) + 0.5)
    across, down = (part.astype(np.float32) - np.float32(0.5) for part in warp.distorted(x, y))
    depth = cv2.remap(
        real.depth, across, down, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT,
        borderValue=np.inf,
    )  # fmt: skip
    return DepthMap(np.asarray(depth, dtype=np.float32))


def distort_defocused(defocused: DefocusedLayer, warp: DistortionMap) -> DefocusedLayer:
    """A distorted layer, before its blur."""
    held = defocused.layer.box
    box = warp.reached(held, _reach(defocused.coc_px))
    places = warp.remap(box, held)
    rgba = _warped(defocused.layer.rgba, places, cv2.INTER_LINEAR)
    depth = _warped(defocused.layer.depth, places, cv2.INTER_NEAREST, cv2.BORDER_REPLICATE)
    coc = _warped(defocused.coc_px, places, cv2.INTER_NEAREST, cv2.BORDER_REPLICATE)
    return DefocusedLayer(layer=ObjectLayer(box=box, rgba=rgba, depth=depth), coc_px=coc)


def _reach(coc_px: Float32) -> int:
    return math.ceil(0.5 * float(np.abs(coc_px).max(initial=0.0))) + 1


def _sharply_warped(values: Float32, places: tuple[Float32, Float32]) -> Float32:
    """Values at places by cubics, each between the least and the greatest of its four neighbours.

    Cubics overshoot beside edges: colour would exceed what alpha covers, as a bright rim, and a
    highlight would be ringed by black.
    """
    warped = _warped(values, places, cv2.INTER_CUBIC)
    for top in range(0, len(warped), _BAND):
        band = warped[top : top + _BAND]
        x, y = (np.floor(part[top : top + _BAND]) for part in places)
        first, end = max(int(y.min()), -1), min(int(y.max()) + 2, len(values))
        if first >= end:
            band[:] = 0.0
            continue
        held = cv2.copyMakeBorder(
            values[max(first, 0) : end], int(first < 0), 1, 1, 1, cv2.BORDER_CONSTANT
        )
        corner = x + np.float32(1.0), y - np.float32(first)
        for extreme, bound in ((cv2.erode, np.maximum), (cv2.dilate, np.minimum)):
            # of each pixel and the next to the right and below
            found = np.asarray(extreme(held, np.ones((2, 2), np.uint8), anchor=(0, 0)), np.float32)
            bound(band, _warped(found, corner, cv2.INTER_NEAREST), out=band)
    return warped


def _warped(
    values: Float32,
    places: tuple[Float32, Float32],
    how: int,
    border: int = cv2.BORDER_CONSTANT,
) -> Float32:
    if not places[0].size:  # beside the frame: OpenCV refuses it
        return np.zeros((*places[0].shape, *values.shape[2:]), np.float32)
    return np.asarray(cv2.remap(values, *places, how, borderMode=border))


def _outline(box: Box) -> tuple[Float64, Float64]:
    """Columns and rows of points all along the border of a box [px]."""
    along = np.linspace(0.0, 1.0, 65)
    x = box.x0 + (box.x1 - box.x0) * along
    y = box.y0 + (box.y1 - box.y0) * along
    ones = np.ones_like(along)
    return (
        np.concatenate([x, x, box.x0 * ones, box.x1 * ones]),
        np.concatenate([box.y0 * ones, box.y1 * ones, y, y]),
    )
