"""How one of several objects stands and moves in the world that they share; turns about up."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64


class Curve(Struct, frozen=True, eq=False, dict=True):
    """Values over time: held before the first key and after the last.

    Smooth curves are the monotone piecewise cubics of Fritsch and Butland (SIAM J. Sci. Stat.
    Comput. 5, 1984, as in PCHIP): between two keys no number leaves the range of theirs, and the
    speed has no jump.

    Attributes:
        times_s: of the keys (K,), strictly increasing, at least one [s].
        values: at them (K, N).
        smooth: whether the curve is; else it is straight between keys.
    """

    times_s: Float64
    values: Float64
    smooth: bool = True

    @cached_property
    def _slopes(self) -> Float64:
        return _monotone_slopes(self.times_s, self.values)

    @property
    def moves(self) -> bool:
        """Whether it is no constant."""
        return bool((self.values != self.values[0]).any())

    def at(self, time_s: float) -> Float64:
        """The values (N,) at a time [s]."""
        after = int(np.searchsorted(self.times_s, time_s, side="right"))
        if after in (0, len(self.times_s)):
            return np.asarray(self.values[min(after, len(self.times_s) - 1)])
        start, end = self.values[after - 1], self.values[after]
        step = float(self.times_s[after] - self.times_s[after - 1])
        share = (time_s - float(self.times_s[after - 1])) / step
        if not self.smooth:
            return np.asarray((1.0 - share) * start + share * end)
        rest = 1.0 - share  # cubic Hermite in the form of Bernstein: a mean of what lies between
        lower = start + step / 3.0 * self._slopes[after - 1]
        upper = end - step / 3.0 * self._slopes[after]
        return np.asarray(
            rest**3 * start + 3.0 * rest**2 * share * lower + 3.0 * rest * share**2 * upper
            + share**3 * end
        )  # fmt: skip


def _monotone_slopes(times_s: Float64, values: Float64) -> Float64:
    """Slopes of a monotone cubic at its keys (K, N)."""
    slopes = np.zeros(values.shape)
    if len(times_s) < 2:
        return slopes
    steps = np.diff(times_s)[:, None]
    secants = np.diff(values, axis=0) / steps
    if len(times_s) == 2:
        return slopes + secants
    before, after = steps[:-1], steps[1:]
    first, second = 2.0 * after + before, after + 2.0 * before
    product = secants[:-1] * secants[1:]
    total = first * secants[1:] + second * secants[:-1]
    np.divide((first + second) * product, total, out=slopes[1:-1], where=product > 0.0)
    slopes[0] = _end_slope(steps[0], steps[1], secants[0], secants[1])
    slopes[-1] = _end_slope(steps[-1], steps[-2], secants[-1], secants[-2])
    return slopes


def _end_slope(step: Float64, next_step: Float64, secant: Float64, next_secant: Float64) -> Float64:
    """Slope at the first key, by three points; kept monotone."""
    slope = ((2.0 * step + next_step) * secant - step * next_secant) / (step + next_step)
    slope = np.where(slope * secant <= 0.0, 0.0, slope)
    turns = (secant * next_secant < 0.0) & (np.abs(slope) > 3.0 * np.abs(secant))
    return np.where(turns, 3.0 * secant, slope)


class ObjectMotion(Struct, frozen=True, eq=False):
    """Where an object's file lies in the shared world, over time.

    Attributes:
        contact: point of the file on which the object stands (3,) [its scene unit].
        axes: directions in the shared world, as columns (3, 3), along which `place` counts.
        place: where that point is (K, 3) [scene unit].
        turn: about the vertical, counter-clockwise seen from above (K, 1) [rad].
        scale: scene units by those of the file, > 0 (K, 1) [1].
    """

    contact: Float64
    axes: Float64
    place: Curve
    turn: Curve
    scale: Curve

    @property
    def moves(self) -> bool:
        """Whether it changes with time."""
        return self.place.moves or self.turn.moves or self.scale.moves

    @property
    def end_s(self) -> float:
        """Time of its last key [s]."""
        return max(float(one.times_s[-1]) for one in (self.place, self.turn, self.scale))

    def place_at(self, time_s: float) -> Float64:
        """The point of the shared world (3,) where it stands at a time [s]."""
        return np.asarray(self.axes @ self.place.at(time_s))

    def turned_at(self, time_s: float) -> Float64:
        """Its rotation (3, 3) at a time [s]."""
        return turn_about_up(float(self.turn.at(time_s)[0]))

    def at(self, time_s: float) -> Float64:
        """The matrix (4, 4) from the file's world to the shared one at a time [s]."""
        world = np.eye(4)
        world[:3, :3] = float(self.scale.at(time_s)[0]) * self.turned_at(time_s)
        world[:3, 3] = self.place_at(time_s) - world[:3, :3] @ self.contact
        return world


def turn_about_up(angle: float) -> Float64:
    """The rotation (3, 3) about the vertical, counter-clockwise seen from above [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def turned_about_up(vectors: Float64, turns: Float64) -> Float64:
    """Vectors turned about the vertical, counterclockwise from above (N, 3).

    Args:
        vectors: one (3,), turned by all angles, or as many as angles (N, 3).
        turns: (N,) [rad].
    """
    cosine, sine = np.cos(turns), np.sin(turns)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack(np.broadcast_arrays(cosine * x + sine * z, y, cosine * z - sine * x), axis=-1)
