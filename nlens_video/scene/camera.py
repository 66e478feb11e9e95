"""The virtual camera: pose and intrinsics on the frame's pixel grid.

The only place where glTF's axes (Y up, camera looks along -Z) meet the picture's (row 0 on top).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlens_video.core.layers import Box, Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """A pinhole camera at one moment.

    Attributes:
        world_from_camera: pose (4, 4), rigid (no scale), glTF axes [scene unit].
        fx: focal length along columns [px].
        fy: focal length along rows [px].
        cx: principal point, column, pixel centres at +0.5 [px].
        cy: principal point, row [px].
        width: columns of the frame [px].
        height: rows of the frame [px].
    """

    world_from_camera: Float64
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @classmethod
    def from_yfov(
        cls,
        world_from_camera: Float64,
        yfov: float,
        width: int,
        height: int,
        pixel_aspect: float = 1.0,
    ) -> Camera:
        """A camera with a vertical field of view, as glTF stores it.

        Args:
            world_from_camera: pose (4, 4).
            yfov: vertical field of view [rad].
            width: columns [px].
            height: rows [px].
            pixel_aspect: width of a pixel by its height (sample aspect ratio) [1].
        """
        fy = 0.5 * height / math.tan(0.5 * yfov)
        return cls(
            world_from_camera=world_from_camera,
            fx=fy / pixel_aspect,
            fy=fy,
            cx=0.5 * width,
            cy=0.5 * height,
            width=width,
            height=height,
        )

    def cropped(self, box: Box) -> Camera:
        """The same camera on a box of its frame."""
        return replace(
            self, cx=self.cx - box.x0, cy=self.cy - box.y0, width=box.width, height=box.height
        )

    @property
    def camera_from_world(self) -> Float64:
        """Inverse of the pose (4, 4)."""
        return np.asarray(np.linalg.inv(self.world_from_camera))

    def to_camera(self, world: Float64) -> Float64:
        """World points (N, 3) in camera space, x right, y up, looking along -z [scene unit]."""
        matrix = self.camera_from_world
        return np.asarray(world @ matrix[:3, :3].T + matrix[:3, 3])

    def pixels(self, camera_points: Float64) -> Float64:
        """Pixel positions (N, 2), column then row, of camera-space points with z < 0 (N, 3)."""
        depth = -camera_points[:, 2]
        return np.stack(
            [
                self.cx + self.fx * camera_points[:, 0] / depth,
                self.cy - self.fy * camera_points[:, 1] / depth,
            ],
            axis=1,
        )

    def plane_disparity(self, ground_y: float) -> Float64:
        """Disparity of the horizontal plane y = ground_y at every pixel centre (H, W).

        Disparity of a plane is affine in the pixel position; it is <= 0 at and above the horizon.

        Args:
            ground_y: height of the plane in the world [scene unit].

        Returns:
            1 / camera-space depth [1 / scene unit]; all zero where the camera lies in the plane.
        """
        columns, rows = np.arange(self.width, dtype=np.float64), np.arange(self.height, dtype=float)
        return self._disparity(columns + 0.5, rows + 0.5, ground_y)

    def corner_disparity(self, ground_y: float) -> Float64:
        """Disparity of that plane at the corners of the frame (2, 2) [1 / scene unit].

        Between them it is affine.
        """
        ends = np.array([0.0, self.width]), np.array([0.0, self.height])
        return self._disparity(*ends, ground_y)

    def plane_points(self, ground_y: float) -> Float64:
        """Points of that plane at pixel centres (H, W, 3); any point where it is not seen."""
        disparity = self.plane_disparity(ground_y)
        depth = 1.0 / np.where(disparity > 0.0, disparity, 1.0)
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = -(np.arange(self.height) + 0.5 - self.cy) / self.fy
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
        rotation, eye = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        return np.asarray(depth[..., None] * (rays @ rotation.T) + eye)

    def _disparity(self, x: Float64, y: Float64, ground_y: float) -> Float64:
        """Disparity of a plane at columns (W,) and rows (H,) of places: (H, W)."""
        up = self.world_from_camera[1, :3]
        below = ground_y - self.world_from_camera[1, 3]
        if below == 0.0:
            return np.zeros((len(y), len(x)))
        columns, rows = (x - self.cx) / self.fx, -(y - self.cy) / self.fy
        return np.asarray((up[0] * columns[None, :] + up[1] * rows[:, None] - up[2]) / below)
