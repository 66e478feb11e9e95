"""Highlights that are out of focus: their discs, and the outlines of these.

A point of light out of focus is an image of the aperture: flat inside, with a steep edge, whatever
else the plate shows. Each is found as a bright, compact region that hardly grows as the threshold
falls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64

_THRESHOLDS = np.linspace(0.95, 0.15, 9)
_MOST_GROWTH = 1.25  # of the area to the next threshold; a Gaussian's grows by 1.3 at least
_LEAST_RADIUS_PX, _MOST_RADIUS = 4.0, 0.08  # of a disc; [px], [frame width]
_LEAST_FILLED = 0.55  # of the bounding box; a disc fills 0.79
_LEAST_CONVEX = 0.97  # area by that of the convex hull
_MOST_LONG = 2.2  # longer by wider side of the bounding box
_LEAST_CONTRAST = 0.12  # between a disc and what surrounds it [code value, 1 is white]
_MOST_UNEVEN = 0.25  # deviation inside a disc [contrast]
_MOST_DISCS = 32
_RAY = np.linspace(0.3, 1.7, 71)  # [radius]
_INSIDE, _AROUND = _RAY <= 0.7, _RAY >= 1.3  # where the levels are read
_WIDEST_EDGE = 14  # between a quarter and three quarters of the contrast [1/50 radius]
_TURN = 2.0 * math.pi  # [rad]
ANGLES = np.linspace(0.0, _TURN, 96, endpoint=False)
"""Directions of an outline, clockwise in the picture from the right [rad]."""
DIRECTIONS = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
"""The same as columns and rows (2, 96)."""
_RAYS = DIRECTIONS[..., None] * _RAY  # columns and rows (2, 96, 71) [radius]


class Discs(Struct, frozen=True, eq=False):
    """Highlights out of focus.

    Attributes:
        middles: columns and rows (N, 2), from the middle of the frame [half diagonal].
        radii_px: of the discs of their area (N,) [px].
        outlines: distance of the edge from the middle (N, 96), the first to the right, the next
            ones clockwise in the picture [radius].
    """

    middles: Float64
    radii_px: Float64
    outlines: Float64


def find_discs(luma: Float32) -> Discs:
    """Highlights out of focus in display-coded luma (H, W) of square pixels."""
    height, width = luma.shape
    half = 0.5 * math.hypot(width, height)
    middles, radii, outlines = [], [], []
    for x, y, radius in _candidates(luma):
        found = _outline(luma, x, y, radius)
        if found is not None:
            (x, y), radius, outline = found
            middles.append(((x + 0.5 - 0.5 * width) / half, (y + 0.5 - 0.5 * height) / half))
            radii.append(radius)
            outlines.append(outline)
        if len(radii) == _MOST_DISCS:
            break
    return Discs(
        np.array(middles).reshape(-1, 2),
        np.array(radii),
        np.array(outlines).reshape(-1, len(ANGLES)),
    )


def _candidates(luma: Float32) -> Iterator[tuple[float, float, float]]:
    """Middle and radius [px] of bright regions with steep edges, each place once."""
    height, width = luma.shape
    taken = np.zeros(luma.shape, np.uint8)
    least, most = math.pi * _LEAST_RADIUS_PX**2, math.pi * (_MOST_RADIUS * width) ** 2
    above: tuple[Float64, Float64] = (
        np.empty((0, 2)),
        np.empty(0),
    )  # middles and areas at the threshold before
    for threshold in _THRESHOLDS:
        mask = (luma >= threshold).view(np.uint8)
        _, labels, stats, centres = cv2.connectedComponentsWithStats(mask, connectivity=4)
        left, top, wide, high, area = stats.T.astype(np.float64)
        inside = (left > 0) & (top > 0) & (left + wide < width) & (top + high < height)
        compact = (
            (area >= least)
            & (area <= most)
            & (area >= _LEAST_FILLED * wide * high)
            & (np.maximum(wide, high) <= _MOST_LONG * np.minimum(wide, high))
        )
        for index in np.flatnonzero(inside & compact):
            if index == 0:
                continue
            x, y = centres[index]
            column, row = round(x), round(y)
            if taken[row, column] or labels[row, column] != index:
                continue
            if not _grew_from(*above, x, y, float(area[index])):
                continue
            radius = math.sqrt(area[index] / math.pi)
            cv2.circle(taken, (column, row), math.ceil(0.5 * radius), 1, cv2.FILLED)
            yield float(x), float(y), radius
        above = np.asarray(centres[1:], np.float64), area[1:]


def _grew_from(centres: Float64, areas: Float64, x: float, y: float, area: float) -> bool:
    """Whether one of the regions at a higher threshold is hardly smaller than it."""
    radius = math.sqrt(area / math.pi)
    near = np.hypot(centres[:, 0] - x, centres[:, 1] - y) < 0.25 * radius
    return bool(near.any()) and area <= _MOST_GROWTH * float(areas[near].max())


def _outline(
    luma: Float32, x: float, y: float, radius: float
) -> tuple[tuple[float, float], float, Float64] | None:
    """Middle, radius [px] and outline of a region as of `Discs`, None where it is no disc."""
    for _ in range(2):  # the second time from the middle of the outline itself
        columns, rows = np.asarray(radius * _RAYS + np.reshape((x, y), (2, 1, 1)), np.float32)
        levels = cv2.remap(luma, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        inner, outer = levels[:, _INSIDE], levels[:, _AROUND]
        inside, around = float(np.median(inner)), float(np.median(outer))
        contrast = inside - around
        if contrast < _LEAST_CONTRAST or float(inner.std()) > _MOST_UNEVEN * contrast:
            return None
        below = levels < 0.5 * (inside + around)
        first = below.argmax(axis=1)
        if not below.any(axis=1).all() or (first == 0).any():
            return None
        ends = [(levels < around + part * contrast).argmax(axis=1) for part in (0.25, 0.75)]
        if np.median(ends[0] - ends[1]) > _WIDEST_EDGE:
            return None
        every = np.arange(len(ANGLES))
        low, high = levels[every, first], levels[every, first - 1]
        part = (high - 0.5 * (inside + around)) / (high - low)
        distance = radius * (_RAY[first - 1] + part * (_RAY[1] - _RAY[0]))
        points = (distance * DIRECTIONS).T + (x, y)
        centre, area = _centroid(points)
        (x, y), radius = centre, math.sqrt(area / math.pi)
    hull = cv2.contourArea(cv2.convexHull(points.astype(np.float32)))
    if radius < _LEAST_RADIUS_PX or area < _LEAST_CONVEX * hull:
        return None
    return (float(x), float(y)), radius, about_middle(points)


def _centroid(points: Float64) -> tuple[Float64, Float64]:
    """Centroids (..., 2) and areas (...) of polygons (..., K, 2)."""
    following = np.roll(points, -1, axis=-2)
    cross = points[..., 0] * following[..., 1] - following[..., 0] * points[..., 1]
    area = np.asarray(0.5 * cross.sum(axis=-1))
    weighted = ((points + following) * cross[..., None]).sum(axis=-2)
    return weighted / (6.0 * area[..., None]), np.abs(area)


def about_middle(points: Float64) -> Float64:
    """Outlines (..., 96) as of `Discs`, of polygons (..., K, 2), stars about their middle."""
    centres, areas = _centroid(points)
    across, down = np.moveaxis(points - centres[..., None, :], -1, 0)
    distance = np.hypot(across, down) / np.sqrt(areas / math.pi)[..., None]
    angle = np.mod(np.arctan2(down, across), _TURN)
    order = np.argsort(angle, axis=-1)
    angle, distance = (np.take_along_axis(one, order, axis=-1) for one in (angle, distance))
    # a point more on each side closes the outline
    angle = np.concatenate([angle[..., -1:] - _TURN, angle, angle[..., :1] + _TURN], axis=-1)
    distance = np.concatenate([distance[..., -1:], distance, distance[..., :1]], axis=-1)
    # each outline on turns of its own, so that one call interpolates all
    turns = 3.0 * _TURN * np.arange(areas.size).reshape(*areas.shape, 1)
    found = np.interp((ANGLES + turns).ravel(), (angle + turns).ravel(), distance.ravel())
    return np.asarray(found.reshape(*areas.shape, len(ANGLES)))
