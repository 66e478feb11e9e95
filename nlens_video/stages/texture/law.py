"""The power that a texture on the ground shows, by its own spectrum and by the lens.

With an unknown spectrum S of the texture in the world, the power of a patch at the frequency f is

    exp(gain) |det J| S(J' f) |H(c f)|^2 exp(-(2 pi s f)^2) + noise,

where J is the change of the pixel position by that of the place on the ground, c = |slope d +
intercept| the diameter of the circle of confusion at the disparity d, H the spectrum of a disc of
diameter 1 and s a softness of the camera that all patches share. The noise is white.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.stages.texture.spectra import Bins, Spectra

LARGEST_PX = 54.0
"""Largest CoC of the law, beyond what F reads."""
MAGNITUDES, DIRECTIONS = 16, 9
"""Knots of the texture's spectrum."""
_WIDTHS = (0.85, 0.95, 1.05, 1.15)  # diameters within a patch, by that in its middle
_LEAST = 1e-6  # power that a disc leaves at least: its zeros are never as deep
_TABLE_STEP = 0.01  # [cycles per diameter]

_Int = npt.NDArray[np.int64]


class Unknowns(Struct, frozen=True, kw_only=True, eq=False):
    """What is solved for, B bands of the ground.

    Attributes:
        spectrum: logarithm of the texture's power at its knots (MAGNITUDES * DIRECTIONS,).
        gain: logarithm of the bands' contrast (B,).
        noise: logarithm of the bands' noise beside the common one (B,).
        common_noise: logarithm of the noise.
        softness: logarithm of the softness s [px].
        slope: of the lens [px * scene unit].
        intercept: of the lens [px].
    """

    spectrum: Float64
    gain: Float64
    noise: Float64
    common_noise: float
    softness: float
    slope: float
    intercept: float

    @classmethod
    def of(cls, vector: Float64) -> Unknowns:
        """From a vector in the order of the attributes."""
        first = MAGNITUDES * DIRECTIONS
        gain, noise = np.split(vector[first:-4], 2)
        common, softness, slope, intercept = (float(value) for value in vector[-4:])
        return cls(
            spectrum=vector[:first], gain=gain, noise=noise, common_noise=common,
            softness=softness, slope=slope, intercept=intercept,
        )  # fmt: skip


class TextureLaw:
    """The law at some places of the ground.

    Args:
        bins: frequencies of the spectra.
        places: P places.
        knots: range of the logarithm of the texture's frequency, None for that of the places.

    Attributes:
        frequency: magnitudes of the bins (1, M) [1 / px].
        disparity: of the places (P,) [1 / scene unit].
        area: logarithm of the area that a place's unit area takes in the picture (P, 1).
        knots: range of the logarithm of the texture's frequency.
    """

    def __init__(
        self, bins: Bins, places: Spectra, knots: tuple[float, float] | None = None
    ) -> None:
        self.frequency, self.disparity = bins.magnitude[None], places.disparity
        self.area = np.log(np.abs(np.linalg.det(places.stretch)))[:, None]
        seen = np.einsum("pij,mi->pmj", places.stretch, bins.vector)
        logarithm = np.log(np.hypot(seen[..., 0], seen[..., 1]))
        turn = np.arctan2(seen[..., 1], seen[..., 0]) % math.pi / math.pi
        low, high = self.knots = knots or (float(logarithm.min()), float(logarithm.max()))
        place = np.clip((logarithm - low) / (high - low), 0.0, 1.0) * (MAGNITUDES - 1)
        self._ring = np.minimum(place.astype(np.int64), MAGNITUDES - 2)
        self._beyond = place - self._ring
        way = turn * DIRECTIONS - 0.5
        self._sector = np.floor(way).astype(np.int64)
        self._after = way - self._sector

    def texture(self, spectrum: Float64) -> Float64:
        """Logarithm of the texture's power (P, M), between its knots."""
        found = np.zeros(self._ring.shape)
        for knot, weight in self._corners():
            found += weight * spectrum[knot]
        return found

    def design(self) -> Float64:
        """Its derivative by the knots (P, M, MAGNITUDES * DIRECTIONS)."""
        whole = np.zeros((*self._ring.shape, MAGNITUDES * DIRECTIONS))
        rows, columns = np.ogrid[: self._ring.shape[0], : self._ring.shape[1]]
        for knot, weight in self._corners():
            whole[rows, columns, knot] += weight
        return whole

    def seen(self, unknown: Unknowns, texture: Float64, gain: Float64) -> Float64:
        """Logarithm of the texture's power in the picture (P, M), without noise.

        Args:
            unknown: softness and lens.
            texture: as `texture` gives it (P, M).
            gain: of the places (P,).
        """
        coc = np.abs(unknown.slope * self.disparity + unknown.intercept)[:, None]
        return np.asarray(
            texture + self.area + gain[:, None] + log_disc(coc * self.frequency)
            - self.softened(unknown.softness)
        )  # fmt: skip

    def softened(self, softness: float) -> Float64:
        """What the softness of a logarithm takes from the log power (1, M)."""
        return np.asarray((2.0 * math.pi * math.exp(softness) * self.frequency) ** 2)

    def _corners(self) -> Iterator[tuple[_Int, Float64]]:
        """The four knots around each frequency and their weights, (P, M) each."""
        for step in (0, 1):
            sector = (self._sector + step) % DIRECTIONS
            beside = self._after if step else 1.0 - self._after
            yield self._ring * DIRECTIONS + sector, (1.0 - self._beyond) * beside
            yield (self._ring + 1) * DIRECTIONS + sector, self._beyond * beside


def log_disc(cycles: Float64) -> Float64:
    """Logarithm of the power that a disc leaves of frequencies [cycles per diameter].

    The mean over diameters by 15 % smaller to larger: within a patch they differ as much.
    """
    table = _disc_table()
    place = np.minimum(cycles / _TABLE_STEP, len(table) - 1.001)
    low = place.astype(np.int64)
    share = place - low
    return np.asarray((1.0 - share) * table[low] + share * table[low + 1])


@lru_cache(maxsize=1)
def _disc_table() -> Float64:
    """At multiples of `_TABLE_STEP`, up to the finest frequency of the largest disc."""
    places = np.arange(0.0, 0.5 * LARGEST_PX, _TABLE_STEP)
    x = math.pi * np.arange(0.0, places[-1] * max(_WIDTHS) + _TABLE_STEP, _TABLE_STEP)
    angle = (np.arange(256) + 0.5) / 256 * math.pi
    # Bessel's integral: the spectrum of a disc is 2 J1(x) / x
    bessel = np.array([np.cos(angle - one * np.sin(angle)).mean() for one in x])
    power = np.square(np.divide(2.0 * bessel, x, out=np.ones_like(x), where=x > 0.0))
    mean = np.mean([np.interp(width * places, x / math.pi, power) for width in _WIDTHS], axis=0)
    return np.asarray(np.log(mean + _LEAST))
