"""The ground of a reconstructed scene: the plane on which the most points lie and few lie below."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.layers import Bool, Float64

_TRIALS = 2000
_STEEPEST = np.cos(np.radians(65.0))  # between a camera's up and the ground's normal
_LARGEST_ROLL = np.sin(np.radians(20.0))
_BELOW_COSTS = 2.0  # a point below the ground speaks against it as two on it speak for it
_LEAST_SHARE = 0.1  # of all points, on the ground
_FEWEST = 20
_ROUNDS = 12
_LEAST_BAND = 0.05  # of the tolerance


def fit_ground(
    points: Float64, poses: Float64, tolerance: float = 0.01, seed: int = 0
) -> tuple[Float64, float] | None:
    """The ground plane under cameras, by consensus of points.

    Its normal leans at most 65 degrees from each camera's up and 20 degrees to its side, and all
    cameras are above it.

    Args:
        points: world positions (N, 3), any unit and axes.
        poses: world-from-camera matrices (F, 4, 4), glTF's camera axes.
        tolerance: distance of a point on the ground, by its distance from the first camera [1].
        seed: of the random trials.

    Returns:
        Unit normal (3,), upwards, and offset, so that normal · point = offset on the ground; None
        where no such plane holds a tenth of the points.
    """
    if len(points) < _FEWEST:
        return None
    band = tolerance * np.linalg.norm(points - poses[0, :3, 3], axis=1)
    rng = np.random.default_rng(seed)
    corners = points[rng.integers(len(points), size=(_TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    some = lengths > 0.0
    corners, normals = corners[some], normals[some] / lengths[some, None]
    normals *= np.sign(normals @ poses[:, :3, 1].mean(axis=0))[:, None]
    offsets = np.einsum("nk,nk->n", normals, corners[:, 0])
    level = _level(normals, offsets, poses)
    normals, offsets = normals[level], offsets[level]
    if not len(normals):
        return None
    heights = normals @ points.T - offsets[:, None]
    votes = (abs(heights) < band).sum(axis=1) - _BELOW_COSTS * (heights < -3.0 * band).sum(axis=1)
    best = int(np.argmax(votes))
    found = _refined(points, band, normals[best], float(offsets[best]))
    # Points of a warped scene lead the fit away from where it began, to a wall for instance.
    if found is None or not _level(found[0][None], np.array([found[1]]), poses)[0]:
        return None
    return found


def _level(normals: Float64, offsets: Float64, poses: Float64) -> Bool:
    """Whether planes (N, 3), (N,) lie below all cameras as a ground may lie (N,)."""
    eyes, rights, ups = poses[:, :3, 3], poses[:, :3, 0], poses[:, :3, 1]
    level = (normals @ ups.T).min(axis=1) > _STEEPEST
    level &= abs(normals @ rights.T).max(axis=1) < _LARGEST_ROLL
    return np.asarray(level & ((normals @ eyes.T).min(axis=1) > offsets))


def _refined(
    points: Float64, band: Float64, normal: Float64, offset: float
) -> tuple[Float64, float] | None:
    """Least squares over the points near a plane, each weighed by its own tolerance.

    The tolerance shrinks to what the points on the plane need: what stands on the ground lies above
    it alone, and would lift it.
    """
    share = 1.0
    for _ in range(_ROUNDS):
        away = abs(points @ normal - offset) / band
        near = away < 2.0 * share
        if near.sum() < max(_FEWEST, _LEAST_SHARE * len(points)):
            return None
        share = min(share, max(_LEAST_BAND, 1.4826 * float(np.median(away[near]))))
        weights = 1.0 / band[near] ** 2
        middle = np.average(points[near], axis=0, weights=weights)
        spread = (points[near] - middle) * np.sqrt(weights)[:, None]
        smallest = np.linalg.svd(spread, full_matrices=False)[2][2]
        normal = smallest * np.sign(smallest @ normal)
        offset = float(normal @ middle)
    return normal, offset


def ground_frame(normal: Float64, offset: float, pose: Float64, height: float) -> Float64:
    """Similarity (4, 4) that makes the ground y = 0 and puts a camera above the origin.

    Args:
        normal: unit normal of the ground (3,).
        offset: normal · point on the ground.
        pose: world-from-camera matrix (4, 4) of the camera that looks along -Z afterwards.
        height: of that camera above the ground afterwards [scene unit].
    """
    eye, back = pose[:3, 3], pose[:3, 2]
    above = float(normal @ eye) - offset
    level = back - (back @ normal) * normal
    if np.linalg.norm(level) < 1e-9:  # looks straight down
        level = pose[:3, 1] - (pose[:3, 1] @ normal) * normal
    z_axis = level / np.linalg.norm(level)
    turn = np.stack([np.cross(normal, z_axis), normal, z_axis])
    scale = height / above
    similarity = np.eye(4)
    similarity[:3, :3] = scale * turn
    similarity[:3, 3] = -scale * turn @ (eye - above * normal)
    return similarity


def moved(camera: SolvedCamera, similarity: Float64) -> SolvedCamera:
    """A camera and its points in a world that is turned, shifted and scaled.

    Args:
        camera: to move; the height of its ground stays as it is given.
        similarity: new world from old (4, 4); its scale is greater than 0.
    """
    scale = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
    keys = []
    for key in camera.keys:
        pose = similarity @ key.world_from_camera
        pose[:3, :3] /= scale
        keys.append(replace(key, world_to_camera=np.asarray(np.linalg.inv(pose))))
    points = camera.points
    if points is not None:
        points = points @ similarity[:3, :3].T + similarity[:3, 3]
    return replace(camera, keys=tuple(keys), points=points)
