"""Surfaces of the filmed things, from the depth of each pixel: places, and what is ground.

A pixel shows the ground where its point lies close to the plane, or where its depth is not known.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, DepthMap, Float32
from nlens_video.effects.shadow.apply import Grid, Shadow
from nlens_video.kernels.channels import any_channel
from nlens_video.scene.camera import Camera

LEVEL = 0.02
"""Height above or below the plane up to which a point is ground, by the camera's height [1]."""


class Things(Struct, frozen=True, kw_only=True, eq=False):
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
        points = camera.points_at(far, x, y)
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
    dark = any_channel(shadow.loss[common.slices_in(shadow.box)])
    if (dark & near[common.y0 : common.y1, common.x0 : common.x1]).any():
        near[:] = False
    return DepthMap(np.where(near, real.depth, np.float32(np.inf)))
