"""P: the projection mask, where the virtual and the real scene coincide (paper, section 4.2).

The object's triangles are cast straight down (-Y) on the ground plane and seen from the camera.
The plate does not contain the object, so none of that footprint is hidden, and the disparity that
belongs to each of its pixels is the plane's, not the object's.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.frames import Bool, Float64
from nlens_video.scene.camera import Camera

_SUBPIXEL_BITS = 4  # cv2 draws with 1/16 px
_REACH_FRAMES = 8.0  # points further out than this many frames are pulled in: cv2 uses 32 bits


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundProjection:
    """The ground plane and the object's footprint on it, as the camera sees them.

    Attributes:
        mask: the footprint (H, W).
        disparity: of the plane at every pixel (H, W), <= 0 where the plane is not seen
            [1 / scene unit].
        ground_y: height of the plane in the world [scene unit].
    """

    mask: Bool
    disparity: Float64
    ground_y: float


def project_to_ground(triangles: Float64, camera: Camera, ground_y: float) -> GroundProjection:
    """Cast triangles down on the plane y = ground_y and rasterise them from the camera.

    Args:
        triangles: world-space corners (T, 3, 3) [scene unit].
        camera: the camera of that moment.
        ground_y: height of the plane [scene unit].

    Returns:
        Mask and disparity on the camera's frame. The mask is empty where the plane is edge-on or
        the footprint out of view.
    """
    disparity = camera.plane_disparity(ground_y)
    mask = np.zeros((camera.height, camera.width), np.uint8)
    if len(triangles):
        fallen = triangles.astype(np.float64).copy()
        fallen[:, :, 1] = ground_y
        seen = camera.to_camera(fallen.reshape(-1, 3)).reshape(-1, 3, 3)
        whole, cut = _in_front(seen)
        _draw(mask, camera.pixels(whole.reshape(-1, 3)).reshape(-1, 3, 2), camera)
        for polygon in cut:
            _draw(mask, camera.pixels(polygon)[None], camera)
    return GroundProjection(
        mask=(mask > 0) & (disparity > 0), disparity=disparity, ground_y=ground_y
    )


def _in_front(triangles: Float64) -> tuple[Float64, list[Float64]]:
    """Camera-space triangles (T, 3, 3) before a near plane, and what is left of those across it."""
    depth = -triangles[:, :, 2]
    near = max(1e-4 * float(depth.max()), np.finfo(np.float64).tiny)
    whole = (depth > near).all(axis=1)
    across = ~whole & (depth > near).any(axis=1)
    return triangles[whole], [_cut(corners, near) for corners in triangles[across]]


def _cut(corners: Float64, near: float) -> Float64:
    """One Sutherland-Hodgman step: the part of a polygon (N, 3) with depth >= near."""
    kept: list[Float64] = []
    for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        depth_first, depth_second = -first[2], -second[2]
        if depth_first >= near:
            kept.append(first)
        if (depth_first >= near) != (depth_second >= near):
            part = (near - depth_first) / (depth_second - depth_first)
            kept.append(first + part * (second - first))
    return np.array(kept)


def _draw(mask: npt.NDArray[np.uint8], polygons: Float64, camera: Camera) -> None:
    """Fill convex polygons (P, N, 2), centres at +0.5, pixels their outlines touch included."""
    reach = _REACH_FRAMES * max(camera.width, camera.height)
    clipped = np.clip(polygons - 0.5, -reach, reach)
    for points in np.round(clipped * (1 << _SUBPIXEL_BITS)).astype(np.int32):
        cv2.fillConvexPoly(mask, points, 1, lineType=cv2.LINE_8, shift=_SUBPIXEL_BITS)
