"""What part of the screen, and of depth, a posed scene takes up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import Box, Float64
from nlens_video.scene.camera import Camera
from nlens_video.scene.posed import PosedScene

if TYPE_CHECKING:
    from nlens_video.scene.screen_projection import Lens


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


def lens_of(camera: Camera, box: Box, near: float) -> Lens:
    """A camera as the kernels read it, looking at a box of its frame.

    Args:
        camera: the camera.
        box: what becomes the picture.
        near: least depth that is drawn [scene unit].
    """
    from nlens_video.scene.screen_projection import Lens

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


@lru_cache(maxsize=4)  # most cameras stand still
def _numbers(camera: Camera) -> Float64:
    """A camera as the kernels read it, looking at its whole frame (17,)."""
    return lens_of(camera, Box(0, 0, camera.width, camera.height), 0.0).numbers()


def misses(points: Float64, camera: Camera, box: Box) -> bool:
    """Whether all that lies in the hull of points (N, 3) is certain to miss a box of the frame."""
    from nlens_video.scene import screen_projection

    corners = (float(end) for end in (box.x0, box.y0, box.x1, box.y1))
    return bool(screen_projection.misses(points, _numbers(camera), *corners))


def travel_bound_px(points: Sequence[Float64], cameras: Sequence[Camera]) -> float:
    """What no point of a body moves more than on the screen, as a sum over its moments [px].

    Args:
        points: in the world (N, 3) at each moment, of which every point of the body is the same
            mean at all of them [scene unit].
        cameras: of each moment, of the same focal length.

    Returns:
        The bound; infinite where a point is not before the camera.
    """
    from nlens_video.scene.screen_projection import travel

    lenses = np.array([_numbers(camera) for camera in cameras])
    return float(travel(np.array(points), lenses))
