"""Corners of a marker where its straight edges meet, which a blurred corner does not tell."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32, Float64

Luma = npt.NDArray[np.uint8] | Float32

_ALONG, _ACROSS = 24, 17  # samples along an edge, and across it
_ENDS = 0.12  # of an edge, left out at both ends
_CELL = 1.0 / 8.0  # of a marker's side: its border is about so wide
_REACH_PX = 1.2, 5.0  # of the samples to either side of a sharp edge
_REACH_SPREADS = 3.0  # of a blurred one: the rise under a disc ends at 2 deviations
_AT_REST_PX, _ROUNDS = 0.01, 20  # the corners move less, or the rounds at most
_STRAYED = 0.5  # of the way to the next cell: then the corners that came in are better


def refine(luma: Luma, corners: Float64) -> Float64:
    """Corners of a dark square on a light ground, to a small part of a pixel.

    Args:
        luma: (H, W), 0 to 255.
        corners: clockwise (4, 2), pixel centres at +0.5, about a pixel off [px].
    """
    start, quad, spread = corners, corners, np.zeros(4)
    for _ in range(_ROUNDS):
        found = _round(luma, quad, spread)
        if found is None:
            return start
        moved = float(np.linalg.norm(found[0] - quad, axis=1).max())
        quad, spread = found
        if moved < _AT_REST_PX:
            break
    cell = _CELL * float(np.linalg.norm(start - np.roll(start, 1, axis=0), axis=1).max())
    near = np.linalg.norm(quad - start, axis=1).max() < max(2.0, _STRAYED * cell)
    return quad if near else start


def _round(luma: Luma, quad: Float64, spread: Float64) -> tuple[Float64, Float64] | None:
    """One round: the edges near those of a quadrangle; None where none are.

    Args:
        luma: (H, W), 0 to 255.
        quad: clockwise (4, 2) [px].
        spread: deviation of the light's rise across each edge, of the last round (4,) [px].

    Returns:
        Where the edges meet (4, 2), and the spread that this round saw (4,) [px].
    """
    ends = np.roll(quad, -1, axis=0)
    along = ends - quad
    along /= np.linalg.norm(along, axis=1)[:, None]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)  # of a clockwise quadrangle, y down
    behind = np.roll(quad, -2, axis=0) - quad, np.roll(quad, -3, axis=0) - quad
    deep = -0.5 * sum((one * outward).sum(axis=1) for one in behind)
    border = 0.7 * _CELL * deep
    reach = np.clip(border, *_REACH_PX)
    reach = np.clip(_REACH_SPREADS * spread, reach, np.maximum(border, reach))
    shares = np.linspace(_ENDS, 1.0 - _ENDS, _ALONG)[:, None]
    on_edge = quad[:, None] + shares * (ends - quad)[:, None]  # (4, along, 2)
    steps = np.linspace(-1.0, 1.0, _ACROSS) * reach[:, None]  # (4, across)
    spots = on_edge[:, :, None] + steps[:, None, :, None] * outward[:, None, None]
    light = sampled(luma, spots)
    rise = np.maximum(np.diff(light, axis=2), 0.0)
    weight = rise.sum(axis=2)  # (4, along)
    if (weight.max(axis=1) < 8.0).any():  # of 255: no edge
        return None
    middle = 0.5 * (steps[:, 1:] + steps[:, :-1])
    offset = (rise * middle[:, None]).sum(axis=2) / (weight + 1e-6)
    points = on_edge + offset[..., None] * outward[:, None]
    lines = [_line(*one) for one in zip(points, weight + 1e-6, strict=True)]
    corners = [np.cross(lines[number - 1], lines[number]) for number in range(4)]
    if any(abs(corner[2]) < 1e-9 for corner in corners):
        return None
    return np.array([corner[:2] / corner[2] for corner in corners]), _spread(light, middle)


def _spread(light: Float32, places: Float64) -> Float64:
    """Deviation of where the light rises across each edge (4,) [px]; noise averages out along it.

    Args:
        light: (4, along, across).
        places: of the steps between the samples across (4, across - 1) [px].
    """
    rise = np.maximum(np.diff(light.mean(axis=1), axis=1), 0.0)
    rise /= rise.sum(axis=1, keepdims=True) + 1e-6
    mean = (rise * places).sum(axis=1, keepdims=True)
    return np.asarray(np.sqrt((rise * (places - mean) ** 2).sum(axis=1)))


def _line(points: Float64, weights: Float64) -> Float64:
    """Line through points (N, 2), those far off it left out, in homogeneous coordinates (3,)."""
    kept = np.ones(len(points), bool)
    for _ in range(3):
        middle = np.average(points[kept], axis=0, weights=weights[kept])
        spread = (points[kept] - middle) * np.sqrt(weights[kept])[:, None]
        normal = np.linalg.svd(spread, full_matrices=False)[2][1]
        off = np.abs((points - middle) @ normal)
        kept = off <= max(3.0 * float(np.median(off[kept])), 0.05)
    return np.array([*normal, -normal @ middle])


def sampled(luma: Luma, spots: Float64) -> Float32:
    """Light at positions (…, 2), between pixels linear.

    Args:
        luma: (H, W).
        spots: columns and rows, pixel centres at +0.5 [px].
    """
    columns, rows = (spots[..., axis].astype(np.float32).reshape(-1, 1) - 0.5 for axis in (0, 1))
    found = cv2.remap(luma, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32).reshape(spots.shape[:-1])
