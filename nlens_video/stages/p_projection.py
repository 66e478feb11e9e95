"""P: the projection mask, where the virtual and the real scene coincide (paper, section 4.2).

The object's triangles are projected straight down (-Y) on the ground plane and seen from the
camera. The plate does not contain the object, so none of that footprint is hidden, and the
disparity of each of its pixels is the plane's, not the object's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Bool, Float64
from nlens_video.kernels.thread_pool import picture_bands
from nlens_video.scene.camera import Camera

Int = npt.NDArray[np.int64]

VISIBILITY_FLOOR_PX = 1.0  # least expected error where the CoC tells ground from other things
_BINS = 8  # parts of the plane, by disparity, each of as many samples
_NO_GROUND, _ALL_GROUND = 0.25, 0.75  # shares of agreeing samples that make 0 and 1
_SUBPIXEL_BITS = 4  # cv2 draws with 1/16 px


class GroundProjection(Struct, frozen=True, kw_only=True):
    """The ground plane and the object's footprint on it, as the camera sees them.

    Attributes:
        mask: the footprint (H, W).
        disparity_of: disparity of the plane (h, w) in some columns (w,) and rows (h,) of pixels,
            <= 0 where it is not seen [1 / scene unit].
        ground_y: height of the plane in the world [scene unit].
        camera: that sees them, None where it is not at hand.
    """

    mask: Bool
    disparity_of: Callable[[Int, Int], Float64]
    ground_y: float
    camera: Camera | None = None

    @property
    def disparity(self) -> Float64:
        """That of every pixel (H, W)."""
        height, width = self.mask.shape
        return self.disparity_of(np.arange(width), np.arange(height))


def project_to_ground(triangles: Float64, camera: Camera, ground_y: float) -> GroundProjection:
    """Project triangles down on the plane y = ground_y and rasterise them from the camera.

    Args:
        triangles: world-space corners (T, 3, 3) [scene unit].
        camera: the camera of that moment.
        ground_y: height of the plane [scene unit].

    Returns:
        Mask and plane on the camera's frame. The mask is empty where the plane is edge-on or the
        footprint out of view.
    """
    mask = np.zeros((camera.height, camera.width), np.uint8)
    if len(triangles):
        fallen = triangles.astype(np.float64)
        fallen[:, :, 1] = ground_y
        seen = camera.to_camera(fallen.reshape(-1, 3)).reshape(-1, 3, 3)
        planes = _view_planes(camera, float(-seen[:, :, 2].min()))
        inside = _inside(seen, planes)
        whole = inside.all(axis=(0, 2))
        _draw(mask, camera.pixels(seen[whole].reshape(-1, 3)).reshape(-1, 3, 2))
        for polygon in seen[~whole & inside.any(axis=2).all(axis=0)]:
            cut = _cut(polygon, planes)
            if len(cut) >= 3:
                _draw(mask, camera.pixels(cut)[None])
    ground = GroundProjection(
        mask=mask.view(np.bool_),
        disparity_of=partial(_disparity, camera, ground_y),
        ground_y=ground_y,
        camera=camera,
    )
    columns = np.arange(camera.width)
    for top, end in picture_bands(camera.height, camera.width):
        ground.mask[top:end] &= ground.disparity_of(columns, np.arange(top, end)) > 0
    return ground


def _disparity(camera: Camera, ground_y: float, columns: Int, rows: Int) -> Float64:
    x, y = columns.astype(np.float64) + 0.5, rows.astype(np.float64) + 0.5
    return camera.disparity_at(x, y, ground_y)


def ground_visibility(
    disparity: Float64, coc_px: Float64, sigma_px: Float64, expected_px: Float64
) -> tuple[tuple[float, float], ...]:
    """Share of the plate that shows the ground plane, by disparity: where the CoCs agree.

    Things that stand on the plane hide what is farther off. From there on the CoCs disagree, or
    they agree and it does no harm.

    Args:
        disparity: of the plane (N,), > 0 [1 / scene unit].
        coc_px: unsigned diameter on the plate (N,) [px].
        sigma_px: its expected error (N,) [px].
        expected_px: unsigned diameter of the plane by the fit (N,) [px].

    Returns:
        Pairs of a disparity, increasing, and the share of ground there, 0 to 1.
    """
    off = np.abs(expected_px - coc_px) / np.maximum(sigma_px, VISIBILITY_FLOOR_PX)
    alike = np.clip(3.0 - off, 0.0, 1.0)
    pairs: list[tuple[float, float]] = []
    for part in np.array_split(np.argsort(disparity, kind="stable"), _BINS):
        if not part.size:
            continue
        at, agreeing = float(disparity[part].mean()), alike[part].mean()
        share = float(np.clip((agreeing - _NO_GROUND) / (_ALL_GROUND - _NO_GROUND), 0.0, 1.0))
        if not pairs or at > pairs[-1][0]:
            pairs.append((at, share))
    return tuple(pairs)


def _view_planes(camera: Camera, farthest: float) -> Float64:
    """The near plane and the sides of the view, a frame wider all round, (5, 4).

    A row (n, d) holds what lies before it: n . p >= d.
    """
    near = max(1e-4 * farthest, np.finfo(np.float64).tiny)
    left, right = (camera.cx + camera.width) / camera.fx, (2 * camera.width - camera.cx) / camera.fx
    top, bottom = (
        (camera.cy + camera.height) / camera.fy,
        (2 * camera.height - camera.cy) / camera.fy,
    )
    return np.array(
        [
            [0, 0, -1, near],
            [1, 0, -left, 0],
            [-1, 0, -right, 0],
            [0, 1, -bottom, 0],
            [0, -1, -top, 0],
        ],
        dtype=np.float64,
    )


def _inside(polygons: Float64, planes: Float64) -> Bool:
    """Whether each corner of camera-space polygons (T, N, 3) lies before each plane (5, T, N)."""
    distance = np.einsum("tni,pi->ptn", polygons, planes[:, :3]) - planes[:, 3, None, None]
    return np.asarray(distance >= 0)


def _cut(corners: Float64, planes: Float64) -> Float64:
    """Sutherland-Hodgman: the part of a camera-space polygon (N, 3) before all planes (M, 3)."""
    for plane in planes:
        distance = corners @ plane[:3] - plane[3]
        kept: list[Float64] = []
        for here, point in enumerate(corners):
            after = (here + 1) % len(corners)
            if distance[here] >= 0:
                kept.append(point)
            if (distance[here] >= 0) != (distance[after] >= 0):
                part = distance[here] / (distance[here] - distance[after])
                kept.append(point + part * (corners[after] - point))
        if len(kept) < 3:
            return np.zeros((0, 3))
        corners = np.array(kept)
    return corners


def _draw(mask: npt.NDArray[np.uint8], polygons: Float64) -> None:
    """Fill convex polygons (P, N, 2), centres at +0.5, pixels their outlines touch included."""
    for points in np.round((polygons - 0.5) * (1 << _SUBPIXEL_BITS)).astype(np.int32):
        cv2.fillConvexPoly(mask, points, 1, lineType=cv2.LINE_8, shift=_SUBPIXEL_BITS)
