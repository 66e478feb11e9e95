"""Surfaces of the filmed things, from the depth of each pixel: places, normals, what is ground.

A pixel shows the ground where its point lies close to the plane, or where its depth is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, DepthMap, Float32, Float64
from nlens_video.effects.shadow.apply import Grid, Shadow
from nlens_video.native import kernels
from nlens_video.scene.camera import Camera

LEVEL = 0.02
"""Height above or below the plane up to which a point is ground, by the camera's height [1]."""
_FITTED_PX = 3  # half a window in which a surface is taken for flat [px]
_STILL = 1e-12  # variance of disparity, by its square, that is rounding


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Things:
    """What the pixels of a grid show.

    Attributes:
        points: of the surfaces (h, w, 3), where their depth is known [scene unit].
        disparity: of these (h, w), 0 where it is not known [1 / scene unit].
        above: their height above the ground (h, w), 0 where it is not known [scene unit].
        level: height up to which a point is ground [scene unit].
    """

    points: Float32
    disparity: Float32
    above: Float32
    level: float

    def off_ground(self, *, below: bool) -> Bool:
        """What is neither ground nor unknown (h, w); with `below` also what lies lower."""
        return np.abs(self.above) > self.level if below else self.above > self.level

    @classmethod
    def seen(cls, real: DepthMap, camera: Camera, ground_y: float, grid: Grid) -> Things:
        """What a frame shows at the pixels of a grid, whose box lies inside it.

        Args:
            real: depth of the frame (H, W).
            camera: of the frame.
            ground_y: height of the ground, below the camera [scene unit].
            grid: of the frame; a coarser one takes the pixel in the middle.
        """
        box, half = grid.box, grid.step // 2
        rows, columns = (
            slice(box.y0 + half, box.y1, grid.step),
            slice(box.x0 + half, box.x1, grid.step),
        )
        depth = real.depth[rows, columns]
        known = np.isfinite(depth)
        far = np.where(known, depth, np.float32(0.0))
        x = np.arange(box.x0 + half, box.x1, grid.step).astype(np.float64) + 0.5
        y = np.arange(box.y0 + half, box.y1, grid.step).astype(np.float64) + 0.5
        points = _places(far, camera, x, y)
        disparity = np.divide(np.float32(1.0), far, out=np.zeros_like(far), where=known)
        above = np.where(known, points[..., 1] - np.float32(ground_y), np.float32(0.0))
        level = LEVEL * (float(camera.world_from_camera[1, 3]) - ground_y)
        return cls(points=points, disparity=disparity, above=above, level=level)


def before_shadow(real: DepthMap, surface: Float32, nearest: float, shadow: Shadow) -> DepthMap:
    """Depth of what stands before the object and the ground, unknown elsewhere.

    All of it is left out where the shadow falls on a part of it, as under a light from behind.

    Args:
        real: depth of the frame (H, W).
        surface: disparity of the ground (H, W) [1 / scene unit].
        nearest: least depth of the object [scene unit].
        shadow: on things and ground.
    """
    height, width = surface.shape
    near = (real.depth < nearest) & (real.depth * surface < 1.0 - LEVEL) & (surface > 0.0)
    shadow = shadow.fine
    common = shadow.box.intersection(Box(0, 0, width, height))
    dark = shadow.loss[common.slices_in(shadow.box)].any(axis=-1)
    if (dark & near[common.y0 : common.y1, common.x0 : common.x1]).any():
        near[:] = False
    return DepthMap(np.where(near, real.depth, np.float32(np.inf)))


def _places(depth: Float32, camera: Camera, columns: Float64, rows: Float64) -> Float32:
    """World points (h, w, 3) at depths (h, w) of columns (w,) and rows (h,) [px]."""
    pose = camera.world_from_camera.astype(np.float32)
    x = np.asarray((columns - camera.cx) / camera.fx, np.float32)[None, :]
    y = np.asarray(-(rows - camera.cy) / camera.fy, np.float32)[:, None]
    planes = [depth * (pose[k, 0] * x + pose[k, 1] * y - pose[k, 2]) + pose[k, 3] for k in range(3)]
    return np.ascontiguousarray(np.stack(planes, axis=-1))


def normals(disparity: Float32, view: Camera) -> Float32:
    """Unit normals (h, w, 3), towards the camera, of surfaces of a disparity (h, w).

    The disparity of a plane is affine in the pixel's position. Of the windows that hold a pixel,
    that which is fitted best lies on its own side of an edge (Kuwahara 1976).

    Args:
        disparity: 0 where it is not known [1 / scene unit].
        view: camera whose pixels are those of `disparity`.
    """
    across, down, left = _flat_windows(disparity.astype(np.float64))
    slopes = np.empty((*disparity.shape, 2), np.float32)
    kernels.best_slopes(across, down, left, _FITTED_PX, slopes)
    # with m = normal / distance: disparity = m . ray for the ray (x, y, -1) of each pixel
    height, width = disparity.shape
    x = ((np.arange(width) + 0.5 - view.cx) / view.fx).astype(np.float32)[None, :]
    y = (-(np.arange(height) + 0.5 - view.cy) / view.fy).astype(np.float32)[:, None]
    a, b = np.float32(-view.fx) * slopes[..., 0], np.float32(view.fy) * slopes[..., 1]
    c = disparity + a * x + b * y
    length = np.maximum(np.sqrt(a * a + b * b + c * c), np.finfo(np.float32).tiny)
    turned = view.world_from_camera[:3, :3].astype(np.float32)
    out = np.empty((*disparity.shape, 3), np.float32)
    for axis in range(3):
        out[..., axis] = (a * turned[axis, 0] + b * turned[axis, 1] + c * turned[axis, 2]) / length
    return out


def _flat_windows(values: Float64) -> tuple[Float64, Float64, Float64]:
    """Slopes along columns and rows of the plane that fits a window, and what it leaves (h, w)."""
    side = 2 * _FITTED_PX + 1
    ones, ramp = np.ones(side) / side, np.arange(-_FITTED_PX, _FITTED_PX + 1) / side
    spread = float((ramp * np.arange(-_FITTED_PX, _FITTED_PX + 1)).sum())  # variance of a place

    def mean(of: Float64, along: Float64, aside: Float64) -> Float64:
        done = cv2.sepFilter2D(of, cv2.CV_64F, along, aside, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(done)

    middle = mean(values, ones, ones)
    across, down = mean(values, ramp, ones) / spread, mean(values, ones, ramp) / spread
    variance = mean(values * values, ones, ones) - middle * middle
    left = variance - spread * (across * across + down * down)
    return across, down, np.maximum(left, _STILL * middle * middle)
