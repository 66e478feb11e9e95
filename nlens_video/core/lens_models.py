"""Lens models by image radius: chromatic aberration, vignetting, distortion; and bloom.

Radii are in half diagonals: 0 in the middle of the frame, 1 in its corners. Pixels are assumed
square.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Aberration:
    """Lateral chromatic aberration: radial displacement of red and blue relative to green.

    Attributes:
        red: (linear, cubic) parts of `linear * r + cubic * r**3`, positive outwards [px].
        blue: the same of blue [px].
    """

    red: tuple[float, float]
    blue: tuple[float, float]

    @property
    def at_corner_px(self) -> float:
        """The larger displacement of both at the corner [px]."""
        return max(abs(sum(self.red)), abs(sum(self.blue)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Vignetting:
    """Loss of light, `square * r**2 + fourth * r**4`.

    Attributes:
        square: [stops].
        fourth: [stops].
    """

    square: float
    fourth: float

    @classmethod
    def of(cls, stops: float) -> Vignetting:
        """The usual shape, half of it in each power, from the loss at the corner [stops]."""
        return cls(square=0.5 * stops, fourth=0.5 * stops)

    @property
    def at_corner_stops(self) -> float:
        """The loss there [stops]."""
        return self.square + self.fourth


@dataclass(frozen=True, slots=True, kw_only=True)
class Distortion:
    """Brown's radial distortion, `distorted = r * (1 + k1 * r**2 + k2 * r**4)`.

    Attributes:
        k1: negative for a barrel [1].
        k2: [1].
        focal_normalized: whether `r` is in focal lengths from the principal point, as in OpenCV;
            otherwise in half diagonals from the middle of the frame.
    """

    k1: float
    k2: float = 0.0
    focal_normalized: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Bloom:
    """Halo around clipped highlights, decaying exponentially.

    Attributes:
        share: of the light at the clip that goes into the halo [1].
        length_px: distance over which the halo falls to 1 / e [px].
    """

    share: float
    length_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LensOverrides:
    """The user's values for the plate's lens; None where a value is estimated from the plate.

    Attributes:
        vignetting_stops: loss of light at the corner [stops].
        distortion: k1 and k2, as in OpenCV [1].
    """

    vignetting_stops: float | None = None
    distortion: tuple[float, float] | None = None


NO_OVERRIDES = LensOverrides()
