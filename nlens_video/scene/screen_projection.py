"""Projection of world positions to the screen, and screen-space bounds of posed scenes and hulls.

Positions are snapped to 1/256 px, whose differences and products are exact in float64: of two
triangles that share an edge exactly one covers a sample on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.native import kernels
from nlens_video.scene.camera import Camera
from nlens_video.scene.posed import PosedScene


def pinhole_params(camera: Camera, box: Box, near: float) -> Float64:
    """A camera that looks at a box of its frame, as the kernels read it (17,).

    Args:
        camera: the camera.
        box: what becomes the picture.
        near: least depth that is drawn [scene unit].

    Returns:
        Its axes in the world (right, up, back), place in the world, fx, fy, cx, cy, near.
    """
    axes, eye = camera.camera_from_world[:3, :3], camera.world_from_camera[:3, 3]
    middle = (camera.cx - box.x0, camera.cy - box.y0)
    return np.array([*axes.ravel(), *eye, camera.fx, camera.fy, *middle, near])


@lru_cache(maxsize=4)  # most cameras stand still
def _frame_params(camera: Camera) -> Float64:
    """Parameters (17,) of a camera that looks at its whole frame."""
    return pinhole_params(camera, Box(0, 0, camera.width, camera.height), 0.0)


def project(positions: Float32, lens: Float64, points: Float64) -> None:
    """Fill in columns and rows [px] and disparities (V, 3); disparity 0 nearer than `near`."""
    kernels.project(positions, lens, points)


def bounds(
    positions: Float32 | Float64, lens: Float64
) -> tuple[float, float, float, float, float, float]:
    """Least and greatest column, row [px] and depth of positions (V, 3).

    Columns and rows are those of positions before the camera; without meaning if any is not.
    """
    return kernels.screen_bounds(positions, lens)


def places(positions: Float32 | Float64, camera: Camera) -> Float64:
    """Columns and rows [px] and depths (V, 3) of positions (V, 3); NaN behind the camera."""
    found = np.empty((len(positions), 3))
    kernels.screen_places(positions, _frame_params(camera), found)
    return found


class Extent(Struct, frozen=True, kw_only=True):
    """Bounds of all vertices that are drawn, as a camera sees them.

    Attributes:
        low: least column and row [px]; without meaning where `nearest` is not above 0.
        high: greatest column and row [px]; likewise.
        nearest: least depth, at or below 0 for what lies beside or behind the camera [scene unit].
        farthest: greatest depth, 0 where nothing is drawn [scene unit].
    """

    low: tuple[float, float]
    high: tuple[float, float]
    nearest: float
    farthest: float

    @classmethod
    def of(cls, found: Float64) -> Extent:
        """That of all rows (N, 6) of `bounds`."""
        low_x, low_y, nearest = (float(v) for v in found[:, 0::2].min(axis=0))
        high_x, high_y, farthest = (float(v) for v in found[:, 1::2].max(axis=0))
        return cls(low=(low_x, low_y), high=(high_x, high_y), nearest=nearest, farthest=farthest)

    def meets(self, box: Box) -> bool:
        """Whether it may lie in a box of the frame; what reaches behind the camera may anywhere."""
        if not (self.farthest > 0.0 and self.nearest > 0.0):
            return self.farthest > 0.0
        (x0, y0), (x1, y1) = self.low, self.high
        return x0 < box.x1 and y0 < box.y1 and x1 > box.x0 and y1 > box.y0


def extent(posed: PosedScene, camera: Camera) -> Extent:
    """Bounds of all vertices that are drawn; numbers that are not finite come through."""
    found = _bounds_of_drawn(posed, camera)
    if not len(found):
        return Extent(low=(0.0, 0.0), high=(0.0, 0.0), nearest=0.0, farthest=0.0)
    return Extent.of(found)


def mesh_extents(posed: PosedScene, camera: Camera) -> list[Extent]:
    """Bounds of each mesh that is drawn."""
    return [Extent.of(row[None]) for row in _bounds_of_drawn(posed, camera)]


def _bounds_of_drawn(posed: PosedScene, camera: Camera) -> Float64:
    """Rows of `bounds` of the meshes that are drawn (N, 6)."""
    lens = _frame_params(camera.about(posed.origin))
    return np.array([bounds(mesh.positions, lens) for mesh in posed.about_origin().drawn])


def misses(points: Float64, camera: Camera, box: Box) -> bool:
    """Whether the convex hull of world points (N, 3) certainly projects outside a box of the frame.

    False where points lie on both sides of the camera plane: their hull may project anywhere.
    """
    low_x, high_x, low_y, high_y, nearest, farthest = bounds(points, _frame_params(camera))
    if farthest <= 0.0:
        return math.isfinite(nearest) and math.isfinite(farthest)
    if not (nearest > 0.0 and all(map(math.isfinite, (low_x, high_x, low_y, high_y)))):
        return False
    return low_x > box.x1 or low_y > box.y1 or high_x < box.x0 or high_y < box.y0


def travel_bound_px(points: Sequence[Float64], cameras: Sequence[Camera]) -> float:
    """Upper bound of the screen-space path length of any point of a body [px].

    Args:
        points: in the world (N, 3) at each moment, of which every point of the body is the same
            convex combination at all of them [scene unit].
        cameras: of each moment, of the same principal point.

    Returns:
        The bound; infinite where a point does not lie in front of the camera.
    """
    return kernels.travel_bound(np.array(points), np.array(list(map(_frame_params, cameras))))


def travel_ref(points: Sequence[Float64], cameras: Sequence[Camera]) -> float:
    """Definition of `travel_bound_px`.

    With f x / z the projection, x1 / z1 - x0 / z0 = ((x1 - x0) - x0 / z0 (z1 - z0)) / z1, and f1 s1
    - f0 s0 = f1 (s1 - s0) + (f1 - f0) s0; each factor is bounded by its maximum over all points.
    """
    pairs = zip(points, cameras, strict=True)
    seen = np.array([camera.to_camera(moment) for moment, camera in pairs])
    depth = -seen[..., 2]
    if not (depth > 0.0).all():
        return math.inf
    slope = np.abs(seen[..., :2] / depth[..., None]).max(axis=(0, 1))
    way = np.abs(np.diff(seen, axis=0)).max(axis=1)
    moved = (way[:, :2] + slope * way[:, 2:]) / depth.min()
    focal = np.array([(camera.fx, camera.fy) for camera in cameras])
    on_screen = focal[1:] * moved + np.abs(np.diff(focal, axis=0)) * slope
    return float(np.hypot(on_screen[:, 0], on_screen[:, 1]).sum())
