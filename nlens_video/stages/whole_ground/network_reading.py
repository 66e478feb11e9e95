"""The lens by a network that sees all patches of the ground together.

F reads the blur place by place, and knows nothing of the scene. The patches of a ground have one
lens, and the camera tells the disparity of each. From many grounds with a known lens the network
has learned how F errs, and weighs the patches by it (`models/lens`).
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.stages.texture.ground_lens import GroundLens
from nlens_video.stages.whole_ground.patches import Patches

CANDIDATES = 5
"""Lenses of an answer."""
NUMBERS = 6
"""Numbers that tell a lens; see `LensNetwork`."""
FEWEST = 20
"""Patches of the ground that a network needs."""
_VARIANCE = 4.0  # of a lens by that which the network states, on rendered plates


class LensNetwork(Protocol):
    """A network that reads the lens off patches of the ground."""

    def __call__(self, patches: Patches, /) -> Float32:
        """Lenses (CANDIDATES, NUMBERS), in units in which the object's disparity is 1.

        Of each its share, a, b, their standard deviations and correlation. The CoC of the ground
        where the object stands is 2 sinh(a) px of the picture, b the logarithm of the slope.
        """
        ...


def read_by_network(
    network: LensNetwork, patches: Patches, middle: float
) -> tuple[GroundLens, ...]:
    """Lenses through which the network takes a ground to be seen, the likeliest first.

    None where the picture shows little ground, or readings that are no numbers.

    Args:
        network: reads them off the patches.
        patches: of the ground.
        middle: disparity of the ground where the object stands [1 / scene unit].
    """
    if len(patches.places) < FEWEST or not np.isfinite(patches.readings).all():
        return ()
    return lenses_of(network(patches), middle)


def lenses_of(answer: Float32, middle: float) -> tuple[GroundLens, ...]:
    """Lenses of a network's answer, the likeliest first; arguments as above."""
    ranked = sorted(np.asarray(answer, np.float64), key=lambda lens: -float(lens[0]))
    best = float(ranked[0][0])
    return tuple(
        GroundLens(
            slope=math.exp(b) / middle,
            intercept=2.0 * math.sinh(a) - math.exp(b),
            covariance=_covariance(a, b, of_a, of_b, correlation, middle),
            unlikelier=-2.0 * math.log(max(share, 1e-12) / best),
        )
        for share, a, b, of_a, of_b, correlation in ranked
    )


def _covariance(
    a: float, b: float, of_a: float, of_b: float, correlation: float, middle: float
) -> Float64:
    """Of slope and intercept (2, 2)."""
    slope = math.exp(b)
    by_answer = np.array([[0.0, slope / middle], [2.0 * math.cosh(a), -slope]])
    shared = correlation * of_a * of_b
    errors = np.array([[of_a**2, shared], [shared, of_b**2]])
    return np.asarray(_VARIANCE * by_answer @ errors @ by_answer.T)
