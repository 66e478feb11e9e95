"""Markers on the ground as cameras see them: observations, and how they lie there."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64
from nlens_video.solve.markers import Sighting
from nlens_video.solve.sources import fov_of_focal

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])  # x, z of side 1
_OFF_GRID, _FEWEST = 0.08, 4  # how far markers of a board are off its grid [spacing]; how many
_TURNED = math.sin(math.radians(8.0))  # between markers of a board
_SPACINGS = np.geomspace(4.0, 1.02, 280)  # sides of a marker


class Corners(Struct, frozen=True, eq=False):
    """Markers as cameras saw them, one row a sighting.

    Attributes:
        side: of a marker [m].
        pixels: corners, clockwise from the marker's upper left (N, 4, 2) [px].
        markers: which one it is, from 0 (N,).
        axes: camera axes from the world's (N, 3, 3).
        shifts: the world's origin in the camera's axes (N, 3) [scene unit].
        focal: focal length (N,) [px].
        middle: principal point (2,) [px].
    """

    side: float
    pixels: Float64
    markers: npt.NDArray[np.int64]
    axes: Float64
    shifts: Float64
    focal: Float64
    middle: Float64

    @property
    def count(self) -> int:
        """How many markers there are."""
        return int(self.markers.max()) + 1

    def take(self, kept: npt.NDArray[np.bool_]) -> Corners:
        """Some of the rows; the markers that remain are numbered anew."""
        _, numbers = np.unique(self.markers[kept], return_inverse=True)
        return replace(
            self, pixels=self.pixels[kept], markers=numbers, axes=self.axes[kept],
            shifts=self.shifts[kept], focal=self.focal[kept],
        )  # fmt: skip

    def largest(self, count: int) -> Corners:
        """The markers that were seen largest."""
        areas = np.zeros(self.count)
        seen = [cv2.contourArea(one.astype(np.float32)) for one in self.pixels]
        np.maximum.at(areas, self.markers, seen)
        return self.take(np.isin(self.markers, np.argsort(-areas, kind="stable")[:count]))

    def stretched(self, share: float, first: Float64) -> Corners:
        """The same sightings by cameras with other focal lengths, as of `stretched_poses`."""
        poses = np.tile(np.eye(4), (len(self.axes), 1, 1))
        poses[:, :3, :3] = self.axes.swapaxes(1, 2)
        poses[:, :3, 3] = -np.einsum("nji,nj->ni", self.axes, self.shifts)
        poses = stretched_poses(poses, share, first)
        axes = poses[:, :3, :3].swapaxes(1, 2)
        return replace(
            self, axes=axes, shifts=-np.einsum("nij,nj->ni", axes, poses[:, :3, 3]),
            focal=share * self.focal,
        )  # fmt: skip

    def project(self, points: Float64, stretch: float) -> Float64:
        """World positions (N, 4, 3) in pixels (N, 4, 2), with focal lengths times `stretch`."""
        seen = np.einsum("nij,nkj->nki", self.axes, points) + self.shifts[:, None]
        depth = np.maximum(-seen[..., 2], 1e-3)
        flat = seen[..., :2] / depth[..., None] * (1.0, -1.0)
        return np.asarray(flat * (stretch * self.focal)[:, None, None] + self.middle)

    def world(self, layout: Float64, turn: Float64, height: float, scale: float) -> Float64:
        """World positions of the corners (N, 4, 3).

        Args:
            layout: x, z and turn of each marker on the ground (M, 3) [m, m, rad].
            turn: axes of the ground in the world (3, 3), its normal in the middle.
            height: of the ground along its normal [scene unit].
            scale: scene units in a metre.
        """
        x, z, yaw = layout[self.markers].T[..., None]
        flat = _CORNERS * self.side
        across = x + np.cos(yaw) * flat[:, 0] - np.sin(yaw) * flat[:, 1]
        down = z + np.sin(yaw) * flat[:, 0] + np.cos(yaw) * flat[:, 1]
        local = np.stack([scale * across, np.full_like(across, height), scale * down], axis=-1)
        return np.asarray(local @ turn.T)

    def layout(self, turn: Float64, height: float, scale: float, stretch: float) -> Float64:
        """How each marker lies on the ground (M, 3), by where the rays of its corners meet it."""
        flat = (self.pixels - self.middle) / (stretch * self.focal)[:, None, None]
        rays = np.concatenate([flat * (1.0, -1.0), np.full((*flat.shape[:2], 1), -1.0)], axis=2)
        rays = np.einsum("nji,nkj->nki", self.axes, rays) @ turn
        eyes = -np.einsum("nji,nj->ni", self.axes, self.shifts) @ turn
        reach = (height - eyes[:, None, 1]) / np.minimum(rays[..., 1], -1e-3)
        met = (eyes[:, None] + reach[..., None] * rays)[..., [0, 2]] / scale
        rows = np.zeros((self.count, 3))
        for marker in range(self.count):
            corners = np.median(met[self.markers == marker], axis=0)
            along = corners[1] + corners[2] - corners[0] - corners[3]
            rows[marker] = *corners.mean(axis=0), math.atan2(along[1], along[0])
        return rows


def observed(camera: SolvedCamera, sightings: list[Sighting], side_m: float) -> Corners:
    """Corners with the cameras that saw them; those of a still camera are averaged.

    Args:
        camera: at the size of the sightings.
        sightings: markers by frame, at least one.
        side_m: of a marker [m].

    Raises:
        InputError: no frame with a marker is among those of the camera.
    """
    if len(camera.keys) == 1:
        seen: dict[int, list[Float64]] = {}
        for sighting in sightings:
            for number, corners in zip(sighting.ids.tolist(), sighting.corners, strict=True):
                seen.setdefault(number, []).append(corners)
        rows = [
            (camera.keys[0], number, np.median(np.array(all_), axis=0))
            for number, all_ in seen.items()
        ]
    else:
        keys = {key.index: key for key in camera.keys}
        rows = [
            (keys[one.frame], number, corners)
            for one in sightings
            if one.frame in keys
            for number, corners in zip(one.ids.tolist(), one.corners, strict=True)
        ]
    if not rows:
        raise InputError("--marker: no frame that shows a marker is solved; give --camera-from")
    names = sorted({number for _, number, _ in rows})
    focal = [0.5 * camera.width / math.tan(0.5 * math.radians(k.fov_x_deg)) for k, _, _ in rows]
    middle = camera.principal_px or (0.5 * camera.width, 0.5 * camera.height)
    return Corners(
        side=side_m,
        pixels=np.array([corners for _, _, corners in rows]),
        markers=np.array([names.index(number) for _, number, _ in rows]),
        axes=np.array([key.world_to_camera[:3, :3] for key, _, _ in rows]),
        shifts=np.array([key.world_to_camera[:3, 3] for key, _, _ in rows]),
        focal=np.array(focal),
        middle=np.array(middle),
    )


def stretched_poses(poses: Float64, share: float, first: Float64) -> Float64:
    """Cameras on a path that see the same pictures with other focal lengths (N, 4, 4).

    The scene stretches along the optical axis of the first camera. What another one sees is the
    same where it does not turn against the first, and nearly so where the change is small.

    Args:
        poses: world-from-camera matrices (N, 4, 4).
        share: new focal lengths by the old ones [1].
        first: world-from-camera matrix of the path's first camera (4, 4).
    """
    along = np.diag([1.0, 1.0, share])
    stretch = _stretch(share, first)
    found = poses.copy()
    # The rotation nearest to what the stretched scene asks for.
    left, _, right = np.linalg.svd(np.linalg.inv(stretch) @ poses[:, :3, :3] @ along)
    found[:, :3, :3] = left @ right
    found[:, :3, 3] = (poses[:, :3, 3] - first[:3, 3]) @ stretch + first[:3, 3]
    return found


def stretched_plane(
    normal: Float64, offset: float, share: float, first: Float64
) -> tuple[Float64, float]:
    """Unit normal and offset of a plane in a scene that is stretched as by `stretched_poses`."""
    leaning = np.linalg.inv(_stretch(share, first)) @ normal
    above = float(normal @ first[:3, 3]) - offset
    length = float(np.linalg.norm(leaning))
    return leaning / length, float(leaning @ first[:3, 3] - above) / length


def stretched(camera: SolvedCamera, share: float) -> SolvedCamera:
    """A path with other focal lengths, as of `stretched_poses`, with its points."""
    first = camera.keys[0].world_from_camera
    poses = np.array([key.world_from_camera for key in camera.keys])
    keys = tuple(
        replace(
            key, world_to_camera=np.asarray(np.linalg.inv(pose)),
            fov_x_deg=fov_of_focal(share * 0.5 / math.tan(0.5 * math.radians(key.fov_x_deg))),
        )
        for key, pose in zip(camera.keys, stretched_poses(poses, share, first), strict=True)
    )  # fmt: skip
    points, eye = camera.points, first[:3, 3]
    if points is not None:
        points = (points - eye) @ _stretch(share, first) + eye
    return replace(
        camera, keys=keys, points=points, distortion_k1=camera.distortion_k1 * share**2
    )  # fmt: skip


def _stretch(share: float, first: Float64) -> Float64:
    """By `share` along a camera's optical axis (3, 3), symmetric."""
    turn = first[:3, :3]
    return np.asarray(turn @ np.diag([1.0, 1.0, share]) @ turn.T)


def ground_axes(about_x: float, about_z: float) -> Float64:
    """Axes of a ground tilted about x, then z [rad] (3, 3), its normal in the middle."""
    return np.asarray(Rotation.from_euler("XZ", [about_x, about_z]).as_matrix())


def as_grid(layout: Float64, side: float) -> tuple[Float64, float, float] | None:
    """The grid on which markers lie, as those of a board do; None where they lie on none.

    Args:
        layout: x, z and turn of each marker (M, 3) [m, m, rad].
        side: of a marker [m].

    Returns:
        Column and row of each marker (M, 2), turn of the grid [rad], spacing [m].
    """
    if len(layout) < _FEWEST:
        return None
    yaw = math.atan2(np.sin(layout[:, 2]).mean(), np.cos(layout[:, 2]).mean())
    if np.abs(np.sin(layout[:, 2] - yaw)).max() > _TURNED:
        return None
    c, s = math.cos(yaw), math.sin(yaw)
    upright = (layout[:, :2] - layout[0, :2]) @ np.array([[c, -s], [s, c]])
    for spacing in _SPACINGS * side:
        grid = upright / spacing
        grid = grid - np.median(grid - np.round(grid), axis=0)
        if np.abs(grid - np.round(grid)).max() < _OFF_GRID:
            return np.round(grid), yaw, float(spacing)
    return None
