"""What part of the screen, and of depth, a posed scene takes up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.frames import Box, Float64
from nlens_video.scene.camera import Camera
from nlens_video.scene.posed import PosedScene

if TYPE_CHECKING:
    from nlens_video.kernels.screen import Lens


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
    from nlens_video.kernels.screen import bounds  # here: numba takes long to load

    box = Box(0, 0, camera.width, camera.height)
    numbers = lens_of(camera, box, 0.0).numbers()
    found = np.array([bounds(mesh.positions, numbers) for mesh in posed.meshes])
    low_x, low_y, nearest = (float(v) for v in found[:, 0::2].min(axis=0))
    high_x, high_y, farthest = (float(v) for v in found[:, 1::2].max(axis=0))
    return Extent(low=(low_x, low_y), high=(high_x, high_y), nearest=nearest, farthest=farthest)


def lens_of(camera: Camera, box: Box, near: float) -> Lens:
    """A camera as the kernels read it, looking at a box of its frame.

    Args:
        camera: the camera.
        box: what becomes the picture.
        near: least depth that is drawn [scene unit].
    """
    from nlens_video.kernels.screen import Lens

    return Lens(
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


def travel_bound_px(seen: Sequence[Float64], camera: Camera) -> float:
    """What no point of a body moves more than on the screen, as a sum over its moments [px].

    Args:
        seen: points in camera space (N, 3) at each moment, of which every point of the body is the
            same mean at all of them; each moment's own camera's [scene unit].
        camera: one of the cameras, for its focal lengths.

    Returns:
        The bound; infinite where a point is not before the camera.
    """
    whole = np.stack(seen)
    depth = -whole[..., 2]
    if not (np.isfinite(whole).all() and depth.min() > 0.0):
        return math.inf
    slant = np.abs(whole[..., :2] / depth[..., None]).max(axis=(0, 1))
    way = np.abs(np.diff(whole, axis=0)).max(axis=1)
    # x1 / z1 - x0 / z0 = ((x1 - x0) - x0 / z0 (z1 - z0)) / z1
    moved = (way[:, :2] + slant * way[:, 2:]) / depth.min()
    return float(np.hypot(camera.fx * moved[:, 0], camera.fy * moved[:, 1]).sum())
