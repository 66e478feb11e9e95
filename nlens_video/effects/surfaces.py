"""Normals of surfaces of which the depth of each pixel is known."""

from __future__ import annotations

import cv2
import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.native import kernels
from nlens_video.scene.camera import Camera

_FITTED_PX = 3  # half a window in which a surface is taken for flat [px]
_STILL = 1e-12  # variance of disparity, by its square, that is rounding


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
