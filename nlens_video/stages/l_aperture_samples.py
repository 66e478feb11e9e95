"""Sample points of an aperture: each the centre of a cell of equal light."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64, Int64
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter.shape import contains, outer_radius, read_picture

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_DENSE = 8192  # points of the aperture that Lloyd's iteration groups into cells
_ROUNDS = 60
_BLOCK = 1 << 16  # distances at a time


class LensPoints(Struct, frozen=True, eq=False):
    """Cells of an aperture.

    Attributes:
        places: their centres (N, 2): u along columns, v along rows; light of CoC c appears
            c / 2 * (u, v) px off [radius of the disc of the aperture's area].
        weights: share of the light that passes through each (N,), their sum is 1 [1].
    """

    places: Float64
    weights: Float64

    @property
    def radii(self) -> Float64:
        """Radius (N,) of the disc of each cell's area [radius of the aperture]."""
        return np.asarray(np.sqrt(self.weights))


def spiral(count: int) -> Float64:
    """Points (N, 2) of the unit disc, each for an equal share of its area: Vogel's spiral."""
    at = np.arange(count)
    radius = np.sqrt((at + 0.5) / count)
    angle = 2.0 * math.pi * _GOLDEN * at
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def pixel_offsets(count: int) -> Float64:
    """Shifts (N, 2) of as many pictures, within a quarter of a pixel: Hammersley's points [px].

    A picture has four samples a pixel on as many columns and rows of it, a quarter apart. With
    these between them, N pictures have 4 N columns and rows. Their mean is 0.
    """
    at = np.arange(count)
    rows = np.array([_reversed_bits(int(n)) for n in at])
    columns = (at + 0.5) / count
    return 0.25 * np.stack([columns - 0.5, rows - rows.mean()], axis=1)


def _reversed_bits(number: int) -> float:
    """Van der Corput's sequence, base 2."""
    value, place = 0.0, 0.5
    while number:
        value, place, number = value + place * (number & 1), 0.5 * place, number >> 1
    return value


def bare_points(count: int) -> LensPoints:
    """Points of equal weight on a round aperture, for views that are not blurred further."""
    return LensPoints(spiral(count), np.full(count, 1.0 / count))


@lru_cache(maxsize=32)
def lens_points(count: int, aperture: Aperture = ROUND) -> LensPoints:
    """Compact cells of an aperture by Lloyd's iteration; deterministic.

    Args:
        count: number of cells, 1 to 256; a picture with fewer lit pixels gives as many as those.
        aperture: its shape, without the cat's eye.

    Raises:
        InputError: the aperture's picture cannot be read.
    """
    places, light = _dense(aperture)
    before = np.cumsum(light)  # seeds: each after an equal share of the light
    seeds = np.searchsorted(before, (np.arange(count) + 0.5) / count * before[-1])
    centres = np.array(places[seeds])
    for _ in range(_ROUNDS):
        cell = _nearest(centres, places)
        mass = np.bincount(cell, light, count).astype(np.float64)
        sums = [np.bincount(cell, light * places[:, axis], count) for axis in (0, 1)]
        lit = mass > 0.0
        centres[lit] = np.stack(sums, axis=1)[lit] / mass[lit, None]
    return LensPoints(centres[lit], mass[lit] / mass.sum())


def _nearest(centres: Float64, places: Float64) -> Int64:
    """Number (M,) of the centre (N, 2) nearest to each place (M, 2); in blocks that fit a cache."""
    x, y = centres.T
    nearest = []
    for some in np.array_split(places, math.ceil(len(places) * len(centres) / _BLOCK)):
        squares = np.square(some[:, :1] - x)
        squares += np.square(some[:, 1:] - y)
        nearest.append(squares.argmin(axis=1))
    return np.concatenate(nearest)


@lru_cache(maxsize=4)
def even_points(count: int) -> Float32:
    """Points (N, 2) of equal weight with the round aperture's mean and second moments; N <= 256."""
    places = lens_points(count).places
    centred = places - places.mean(axis=0)
    spread = np.mean(np.sum(centred * centred, axis=1))
    return np.asarray(centred * math.sqrt(0.5 / spread), dtype=np.float32)


def points_around(count: int, aperture: Aperture = ROUND) -> LensPoints:
    """The aperture's centre and a ring about it, each for a round cell of equal light.

    With the ring at sqrt(1/2) the cells have the second moment of the whole disc. It is turned so
    that no two of four points share a column or row.

    Args:
        count: points on the ring, at least 3.
        aperture: its shape; blades count as the disc of their area. A picture, which may be dark in
            the middle, gives its `lens_points`.
    """
    if aperture.image is not None:
        return lens_points(count + 1, aperture)
    angle = math.atan(2.0) + 2.0 * math.pi / count * np.arange(count)
    ring = math.sqrt(0.5) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places = np.concatenate([np.zeros((1, 2)), ring])
    return LensPoints(places, np.full(count + 1, 1.0 / (count + 1)))


def _dense(aperture: Aperture) -> tuple[Float64, Float64]:
    """Many points (M, 2) of an aperture, turned as a near highlight shows it, their light (M,)."""
    if aperture.image is None:
        disc = outer_radius(aperture) * spiral(_DENSE)
        disc = disc[contains(aperture, disc[:, 0], disc[:, 1])]
        return -disc, np.ones(len(disc))
    picture = read_picture(aperture.image)
    rows, columns = np.nonzero(picture)
    middle = 0.5 * np.array([picture.shape[1], picture.shape[0]])
    places = np.stack([columns, rows], axis=1) + 0.5 - middle
    light = picture[rows, columns]
    return -places / math.sqrt(light.sum() / math.pi), light
