"""A lens that the ground as a whole tells."""

from __future__ import annotations

from msgspec import Struct

from nlens_video.core.layers import Float64


class GroundLens(Struct, frozen=True, kw_only=True, eq=False):
    """The lens model as the whole ground tells it.

    Attributes:
        slope: [px * scene unit].
        intercept: [px].
        covariance: of slope and intercept (2, 2).
        unlikelier: than the likeliest: twice the difference of the logarithms, >= 0 [1].
    """

    slope: float
    intercept: float
    covariance: Float64
    unlikelier: float = 0.0

    def scaled(self, ratio: float) -> GroundLens:
        """For a picture that is wider by a factor."""
        return GroundLens(
            slope=ratio * self.slope,
            intercept=ratio * self.intercept,
            covariance=ratio**2 * self.covariance,
            unlikelier=self.unlikelier,
        )
