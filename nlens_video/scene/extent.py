"""Screen-space and depth bounds of a posed scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import Box, Float64
from nlens_video.scene.camera import Camera
from nlens_video.scene.posed import PosedScene

if TYPE_CHECKING:
    from nlens_video.scene.screen_projection import PinholeParams


@dataclass(frozen=True, slots=True, kw_only=True)
class Extent:
    """Bounds of all vertices as a camera sees them.

    Attributes:
        low: least column and row [px]; without meaning where `nearest` is not above 0.
        high: greatest column and row [px]; likewise.
        nearest: least depth, at or below 0 for what lies beside or behind the camera [scene unit].
        farthest: greatest depth [scene unit].
    """

    low: tuple[float, float]
    high: tuple[float, float]
    nearest: float
    farthest: float


def extent(posed: PosedScene, camera: Camera) -> Extent:
    """Bounds of all vertices; numbers that are not finite come through."""
    from nlens_video.scene.screen_projection import bounds  # here: numba takes long to load

    numbers = _numbers(camera)
    found = np.array([bounds(mesh.positions, numbers) for mesh in posed.meshes])
    low_x, low_y, nearest = (float(v) for v in found[:, 0::2].min(axis=0))
    high_x, high_y, farthest = (float(v) for v in found[:, 1::2].max(axis=0))
    return Extent(low=(low_x, low_y), high=(high_x, high_y), nearest=nearest, farthest=farthest)


def pinhole_params(camera: Camera, box: Box, near: float) -> PinholeParams:
    """A camera as the kernels read it, looking at a box of its frame.

    Args:
        camera: the camera.
        box: what becomes the picture.
        near: least depth that is drawn [scene unit].
    """
    from nlens_video.scene.screen_projection import PinholeParams

    return PinholeParams(
        axes=camera.camera_from_world[:3, :3],
        eye=camera.world_from_camera[:3, 3],
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx - box.x0,
        cy=camera.cy - box.y0,
        near=near,
        width=box.width,
        height=box.height,
    )


@lru_cache(maxsize=4)  # most cameras stand still
def _numbers(camera: Camera) -> Float64:
    """A camera as the kernels read it, looking at its whole frame (17,)."""
    return pinhole_params(camera, Box(0, 0, camera.width, camera.height), 0.0).numbers()


def misses(points: Float64, camera: Camera, box: Box) -> bool:
    """Whether the convex hull of world points (N, 3) certainly projects outside a box of the frame.

    False where points lie on both sides of the camera plane: their hull may project anywhere.
    """
    seen = camera.to_camera(points)
    before = seen[:, 2] < 0.0
    if not before.all():
        return len(points) > 0 and not before.any() and not np.isnan(seen).any()
    x, y = camera.pixels(seen).T
    if not len(points) or not (np.isfinite(x).all() and np.isfinite(y).all()):
        return False
    return bool(x.min() > box.x1 or y.min() > box.y1 or x.max() < box.x0 or y.max() < box.y0)


def travel_bound_px(points: Sequence[Float64], cameras: Sequence[Camera]) -> float:
    """Upper bound of the screen-space path length of any point of a body [px].

    With x / z the projection, x1 / z1 - x0 / z0 = ((x1 - x0) - x0 / z0 (z1 - z0)) / z1; each factor
    is bounded by its maximum over all points.

    Args:
        points: in the world (N, 3) at each moment, of which every point of the body is the same
            convex combination at all of them [scene unit].
        cameras: of each moment, of the same focal length.

    Returns:
        The bound; infinite where a point does not lie in front of the camera.
    """
    pairs = zip(points, cameras, strict=True)
    seen = np.array([camera.to_camera(moment) for moment, camera in pairs])
    depth = -seen[..., 2]
    if not (np.isfinite(seen).all() and (depth > 0.0).all()):
        return math.inf
    slope = np.abs(seen[..., :2] / depth[..., None]).max(axis=(0, 1))
    way = np.abs(np.diff(seen, axis=0)).max(axis=1)
    moved = (way[:, :2] + slope * way[:, 2:]) / depth.min()
    return float(np.hypot(cameras[0].fx * moved[:, 0], cameras[0].fy * moved[:, 1]).sum())
