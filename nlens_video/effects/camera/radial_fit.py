"""Robust fit of a displacement along the radius to many small measurements, with its certainty."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, Float64

LEAST_CERTAINTY = 12.0  # standard errors
_LEAST_WINDOWS = 40
_QUADRANT_WINDOWS = 6
_LEAST_IN_QUADRANT = 0.25  # of the whole
_ROUNDS = 12
_OUTLIER = 2.5  # deviations; Tukey's loss lets go at twice that
_FIRST_EXTRA_PX = 1.0
_MEDIAN_OF_CHI_SQUARED = 1.386  # of two degrees of freedom
_LEAST_CERTAINTY_OF_BEND = 3.0
_UNIT = np.array([[1.0], [0.0], [1.0]])  # matrix, as `_product` takes it


class RadialFit(Struct, frozen=True, kw_only=True):
    """Displacement `linear * r + cubic * r**3` outwards, r = 1 at the corner.

    Attributes:
        linear: [px].
        cubic: [px].
        at_corner: figure there [px].
        certainty: of the figure at the corner, in standard errors [1].
        quadrants: displacement that each quadrant alone would give [px].
        count: measurements behind it [1].
        others: amplitude of each of the shapes that were fitted beside it.
    """

    linear: float = 0.0
    cubic: float = 0.0
    at_corner: float = 0.0
    certainty: float = 0.0
    quadrants: tuple[float, ...] = ()
    count: int = 0
    others: tuple[float, ...] = ()

    @property
    def consistent(self) -> bool:
        """Whether it is certain, and every quadrant says so."""
        sign = math.copysign(1.0, self.at_corner)
        least = min((sign * part for part in self.quadrants), default=0.0)
        alike = least > _LEAST_IN_QUADRANT * abs(self.at_corner)
        return alike and self.certainty >= LEAST_CERTAINTY

    def describe(self) -> str:
        """Its certainty, for people."""
        alike = "alike in all quadrants" if self.consistent else "not alike in all quadrants"
        return f"{self.certainty:.0f} times its standard error in {self.count} windows, {alike}"

    def after(self, before: RadialFit) -> RadialFit:
        """This fit added to one that was undone first."""
        error = abs(self.at_corner) / self.certainty if self.certainty else math.inf
        total = self.at_corner + before.at_corner
        return replace(
            self,
            linear=self.linear + before.linear,
            cubic=self.cubic + before.cubic,
            at_corner=total,
            certainty=abs(total) / error,
            quadrants=tuple(part + before.at_corner for part in self.quadrants),
        )


class Windows(Struct, frozen=True, kw_only=True, eq=False):
    """Measurements in small windows of a picture.

    Attributes:
        x: columns of their centres from that of the picture (N,) [half diagonal].
        y: rows (N,) [half diagonal].
        moved: displacements across and down (N, 2) [px].
        covariance: of them (N, 2, 2) [px^2].
        trust: further weights (N,) [1].
        others: displacements of shapes that no lens causes, fitted as well (N, 2, M).
    """

    x: Float64
    y: Float64
    moved: Float64
    covariance: Float64
    trust: Float64
    others: Float64 | None = None


def fit_radial(windows: Windows, corner: tuple[float, float] = (1.0, 1.0)) -> RadialFit:
    """Fit a displacement along the radius, and a shift of all windows.

    `corner` gives the weights of the linear and the cubic part in the figure at the corner [1].
    """
    x, y = windows.x, windows.y
    if len(x) < _LEAST_WINDOWS:
        return RadialFit(count=len(x))
    place = np.stack([x, y])
    square = (place**2).sum(axis=0)
    plain = _Lines.on(windows, cubic=False)
    curved = _Lines.on(windows, cubic=True)
    # a cubic part that is not significant only adds errors at the corner, where few windows lie
    shapes = 0 if windows.others is None else windows.others.shape[2]
    bent = abs(curved.answer[3]) > _LEAST_CERTAINTY_OF_BEND * curved.error(
        _picked(0.0, 0.0, 0.0, 1.0, zeros=shapes)
    )
    lines = curved if bent else plain
    linear, cubic = lines.answer[2], lines.answer[3] if bent else 0.0
    at_corner = float(corner[0] * linear + corner[1] * cubic)
    error = lines.error(_picked(0.0, 0.0, *corner[: 1 + bent], zeros=shapes))
    shape = linear + cubic * square
    quadrants = [((x > 0) == right) & ((y > 0) == low)
                 for right in (False, True) for low in (False, True)]  # fmt: skip
    shares = lines.shares(quadrants, place * shape)
    return RadialFit(
        linear=float(linear),
        cubic=float(cubic),
        at_corner=at_corner,
        certainty=abs(at_corner) / error if error else 0.0,
        quadrants=tuple(share * at_corner for share in shares),
        count=len(x),
        others=tuple(lines.answer[len(lines.answer) - shapes :].tolist()),
    )


def _inverse(matrices: Float64) -> Float64:
    """Inverses of symmetric 2x2 matrices, as `_product` takes them."""
    xx, xy, yy = matrices
    return np.asarray(np.stack([yy, -xy, xx]) / (xx * yy - xy * xy))


def _product(matrices: Float64, vectors: Float64) -> Float64:
    """Symmetric 2x2 matrices, the rows (3, N) being xx, xy and yy, by vectors (..., 2, N)."""
    xx, xy, yy = matrices
    x, y = vectors[..., 0, :], vectors[..., 1, :]
    return np.stack([xx * x + xy * y, xy * x + yy * y], axis=-2)


def _picked(*weights: float, zeros: int) -> Float64:
    return np.array([*weights, *([0.0] * zeros)])


class _Lines(Struct, frozen=True):
    """A robust weighted least-squares fit of displacements, two equations a window.

    Attributes:
        answer: shift across, shift down, linear, cubic where it is there, other shapes (K,) [px].
        inverse: of the normal matrix.
        scores: contribution of each window to the gradient (K, N).
        weights: information of each window under the loss (3, N), as of `_product` [1 / px^2].
        moved: displacements without the shift and the other shapes (2, N) [px].
        clusters: number of the cluster of each window (N,).
    """

    answer: Float64
    inverse: Float64
    scores: Float64
    weights: Float64
    moved: Float64
    clusters: Float64

    @classmethod
    def on(cls, windows: Windows, *, cubic: bool) -> _Lines:
        place = np.stack([windows.x, windows.y])
        square = (place**2).sum(axis=0)
        one, zero = np.ones_like(square), np.zeros_like(square)
        columns = [np.stack([one, zero]), np.stack([zero, one]), place]
        if cubic:
            columns.append(place * square)
        design = np.stack(columns)
        if windows.others is not None:
            design = np.concatenate([design, windows.others.transpose(2, 1, 0)])
        count = len(design)
        flat = design.reshape(count, -1)  # (K, 2 N): sums over windows are products
        moved = np.ascontiguousarray(windows.moved.T)
        covariance = windows.covariance.reshape(-1, 4).T[[0, 1, 3]]
        answer = np.zeros(count)
        extra = _FIRST_EXTRA_PX**2
        for _ in range(_ROUNDS):
            information = _inverse(covariance + extra * _UNIT)
            off = moved - (answer @ flat).reshape(moved.shape)
            distance = (off * _product(information, off)).sum(axis=0)
            loss = np.clip(1.0 - distance / (4.0 * _OUTLIER**2), 0.0, 1.0) ** 2
            weights = loss * windows.trust * information
            weighted = _product(weights, design)
            sums = weighted.reshape(flat.shape)
            inverse = np.linalg.inv(sums @ flat.T + 1e-9 * np.eye(count))
            answer = inverse @ (sums @ moved.reshape(-1))
            # windows differ by more than their noise: coloured edges add to it
            extra = max(1e-6, extra * float(np.median(distance)) / _MEDIAN_OF_CHI_SQUARED)
        off = moved - (answer @ flat).reshape(moved.shape)
        turn = np.floor((np.arctan2(place[1], place[0]) / np.pi + 1.0) * 8.0)
        ring = np.floor(np.minimum(np.sqrt(square), 0.99) * 4.0)
        radial = slice(2, 3 + cubic)
        return cls(
            answer, inverse, (weighted * off).sum(axis=1), weights,
            off + np.tensordot(answer[radial], design[radial], axes=1), turn * 4 + ring,
        )  # fmt: skip

    def error(self, of: Float64) -> float:
        """Standard error of a combination of the answer; neighbours may err alike [px]."""
        _, numbers = np.unique(self.clusters, return_inverse=True)
        sums = np.stack([np.bincount(numbers, scores) for scores in self.scores])
        middle = sums @ sums.T
        return float(np.sqrt(of @ self.inverse @ middle @ self.inverse @ of))

    def shares(self, parts: Sequence[Bool], model: Float64) -> list[float]:
        """Amplitude of the displacement `model` (2, N) in each part of the windows [1]."""
        weighted = _product(self.weights, model)
        told, seen = ((weighted * by).sum(axis=0) for by in (model, self.moved))
        return [
            float(seen[here].sum() / told[here].sum())
            if here.sum() >= _QUADRANT_WINDOWS and told[here].sum() > 0
            else 0.0
            for here in parts
        ]
