"""A camera that moves over even ground alone: keyframes from the plane's homographies.

All points of a plane go with any fundamental matrix that agrees with its homography, so structure
from motion that begins with two keyframes may begin with a wrong pair of poses, and then ends at a
wrong focal length. All homographies together have few solutions: by the right focal length and
normal each of them keeps the lengths and angles of the plane (Triggs, Autocalibration from planar
scenes, 1998).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy.optimize import least_squares

from nlens_video.core.layers import Float64
from nlens_video.solve.paths.bundle import Bundle, pose_of
from nlens_video.solve.points.observations import Table

_FEWEST_KEYFRAMES, _FEWEST_SHARED = 3, 30
_PLANE_PX, _TRIALS = 2.0, 300  # of RANSAC
_FOCALS = np.geomspace(0.35, 3.0, 12)  # tried first, by the frame's width [1]
_NORMALS = 300  # tried first, of the half sphere before the camera
_SOUGHT, _KEPT = 8, 3  # beginnings that are refined, and solutions
_LOSS = 0.01  # of a change of lengths and angles, by the length [1]
_ALIKE = 0.3, 0.95  # beginnings that are one: log focal length, cosine of the normals
_SAME = 0.05, 0.995  # solutions that are one
_FARTHEST_PX, _PLANE_ONLY_PX = 3.0, 1.5  # beside the plane, at most counted; where all lies in it


def plane_bundles(
    table: Table, count: int, size: tuple[int, int], focal_px: float | None
) -> list[Bundle]:
    """Keyframes whose points lie in one plane, with one focal length; one for each solution.

    Args:
        table: observations in the keyframes.
        count: number of keyframes.
        size: columns and rows [px].
        focal_px: focal length where it is known [px].

    Returns:
        Adjusted bundles; none where the points have depth beside a plane, or where there are fewer
        than three keyframes.
    """
    maps = _homographies(table, count, size) if count >= _FEWEST_KEYFRAMES else None
    if maps is None or _beside_px(table, size, maps) > _PLANE_ONLY_PX:
        return []
    free = focal_px is None
    found = [
        _bundle(table, size, maps, focal, normal)
        for focal, normal in _solutions(maps, None if focal_px is None else focal_px / size[0])
    ]
    # What the first adjustment brings near is used by the second.
    return [
        bundle.adjusted(focal=free).adjusted(focal=free)
        for bundle in found
        if bundle.believed().any()
    ]


def _homographies(table: Table, count: int, size: tuple[int, int]) -> Float64 | None:
    """From the first keyframe to each (K, 3, 3), of determinant 1; positions by the width.

    None where two keyframes that follow share too few points.
    """
    found = [np.eye(3)]
    for place in range(1, count):
        before, after = table.at(place - 1), table.at(place)
        _, one, two = np.intersect1d(before[0], after[0], return_indices=True)
        if len(one) < _FEWEST_SHARED:
            return None
        matrix, _ = cv2.findHomography(
            _flat(before[1][one], size), _flat(after[1][two], size), cv2.RANSAC,
            _PLANE_PX / size[0], maxIters=_TRIALS,
        )  # fmt: skip
        if matrix is None or np.linalg.det(matrix) <= 0.0:
            return None
        found.append(matrix @ found[-1])
    maps = np.array(found)
    return np.asarray(maps / np.cbrt(np.linalg.det(maps))[:, None, None])


def _beside_px(table: Table, size: tuple[int, int], maps: Float64) -> float:
    """Mean distance of the observations from where the plane has their points, 3 px at most [px].

    A point lies where it is first seen.
    """
    flat = np.column_stack([_flat(table.pixels, size), np.ones(len(table.pixels))])
    on_first = np.linalg.solve(maps[table.places], flat[..., None])[..., 0]
    points = np.empty((len(table.names), 3))
    order = np.argsort(-table.places, kind="stable")  # the earliest is written last
    points[table.numbers[order]] = on_first[order]
    there = (maps[table.places] @ points[table.numbers][..., None])[..., 0]
    away = np.linalg.norm(there[:, :2] / there[:, 2:] - flat[:, :2], axis=1) * size[0]
    return float(np.minimum(np.nan_to_num(away, nan=_FARTHEST_PX), _FARTHEST_PX).mean())


def _flat(pixels: Float64, size: tuple[int, int]) -> Float64:
    """Positions from the frame's middle, Y down, by its width (N, 2)."""
    return np.asarray((pixels - np.array(size) / 2.0) / size[0])


def _solutions(maps: Float64, focal: float | None) -> list[tuple[float, Float64]]:
    """Focal lengths by the width, and normals (3,) away from the camera, the best first."""
    step: Float64 = np.arange(0.5, _NORMALS)  # a Fibonacci lattice
    normals = _direction(math.pi * (1.0 + math.sqrt(5.0)) * step, np.arccos(1.0 - step / _NORMALS))
    tried = _FOCALS if focal is None else np.array([focal])
    focals, normals = np.repeat(tried, len(normals)), np.tile(normals, (len(tried), 1))
    costs = np.square(changes(maps, focals, normals)).sum(axis=1)
    begun: list[tuple[float, Float64]] = []
    found: list[tuple[float, float, Float64]] = []
    for n in np.argsort(costs):
        if len(begun) == _SOUGHT:
            break
        if _among(begun, focals[n], normals[n], *_ALIKE):
            continue
        begun.append((focals[n], normals[n]))
        cost, length, normal = _refined(maps, focals[n], normals[n], free=focal is None)
        if not _among([(one[1], one[2]) for one in found], length, normal, *_SAME):
            found.append((cost, length, normal))
    found.sort(key=lambda one: one[0])
    return [(length, normal) for _, length, normal in found[:_KEPT]]


def _refined(
    maps: Float64, focal: float, normal: Float64, *, free: bool
) -> tuple[float, float, Float64]:
    """Cost, focal length and normal of the least changes near some."""
    start = [math.atan2(normal[1], normal[0]), math.acos(normal[2]), math.log(focal)]

    def of(values: Float64) -> tuple[Float64, Float64]:
        return np.exp(values[2:] if free else start[2:]), _direction(values[:1], values[1:2])

    def residuals(values: Float64) -> Float64:
        focals, normals = of(values)
        return np.asarray(changes(maps, focals, normals)[0])

    solved = least_squares(residuals, start[: 3 if free else 2], loss="soft_l1", f_scale=_LOSS)
    (length,), (found,) = of(solved.x)
    return float(solved.cost), float(length), found if found[2] >= 0.0 else -found


def _among(
    known: list[tuple[float, Float64]], focal: float, normal: Float64, apart: float, cosine: float
) -> bool:
    return any(
        abs(math.log(focal / one)) < apart and abs(normal @ other) > cosine for one, other in known
    )


def _direction(around: Float64, away: Float64) -> Float64:
    """Unit vectors (N, 3) by their angles about Z and from it [rad]."""
    flat = np.sin(away)
    return np.stack([np.cos(around) * flat, np.sin(around) * flat, np.cos(away)], axis=-1)


def changes(maps: Float64, focals: Float64, normals: Float64) -> Float64:
    """By how much homographies change lengths and angles in a plane; 0 for the right plane [1].

    Args:
        maps: homographies (K, 3, 3), positions by the frame's width.
        focals: focal lengths by the width (N,).
        normals: of the plane in the axes of the first keyframe, X right, Y down (N, 3).

    Returns:
        (N, 2 K): differences of two lengths by them, and cosines between two right angles.
    """
    scale = np.stack([focals, focals, np.ones_like(focals)], axis=-1)
    moved = [
        np.einsum("kij,nj->nki", maps, along * scale) / scale[:, None]
        for along in _in_plane(normals)
    ]
    first, second = ((one * one).sum(axis=-1) for one in moved)
    across = (moved[0] * moved[1]).sum(axis=-1)
    differences = np.concatenate([first - second, 2.0 * across], axis=1)
    return np.asarray(differences / np.tile(first + second, 2))


def _in_plane(normals: Float64) -> tuple[Float64, Float64]:
    """Two unit vectors at right angles in each plane (N, 3), whose product is the normal."""
    upright = np.abs(normals[:, 2:]) < 0.9
    beside = np.where(upright, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    first = np.cross(beside, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)


def _bundle(
    table: Table, size: tuple[int, int], maps: Float64, focal: float, normal: Float64
) -> Bundle:
    """Poses by the homographies, and points on the plane at distance 1 from the first keyframe."""
    scale = np.array([focal, focal, 1.0])
    axes = np.stack([*(one[0] for one in _in_plane(normal[None])), normal], axis=1)
    poses = np.empty((len(maps), 4, 4))
    points = np.full((len(table.names), 3), np.nan)
    for place in reversed(range(len(maps))):  # a point is where it is first seen
        moved = (maps[place] * scale / scale[:, None]) @ axes
        size_of = math.sqrt(0.5 * float(np.square(moved[:, :2]).sum()))
        along = moved[:, :2] / size_of
        u, _, v = np.linalg.svd(np.column_stack([along, np.cross(along[:, 0], along[:, 1])]))
        turn = u @ v @ axes.T
        shift = moved[:, 2] / size_of - turn @ normal
        poses[place] = pose_of(np.column_stack([turn, shift]))
        numbers, pixels = table.at(place)
        rays = np.column_stack([_flat(pixels, size) / focal, np.ones(len(pixels))])
        here = turn @ normal
        depth = (1.0 + here @ shift) / (rays @ here)
        points[numbers] = (rays * depth[:, None] - shift) @ turn
    return Bundle(table, size, poses, np.full(len(maps), focal * size[0]), points)
