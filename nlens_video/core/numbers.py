"""Numbers with as many digits as their error warrants."""

from __future__ import annotations

import math

_MOST_DECIMALS = 6


def with_error(value: float, error: float) -> str:
    """A value and its standard error, rounded to the error's second digit: "65.2 ± 1.3".

    An error of 0 is not known; the value then stands alone with four digits.
    """
    if not (error > 0.0 and math.isfinite(error) and math.isfinite(value)):
        return f"{value:.4g}"
    decimals = min(1 - math.floor(math.log10(error)), _MOST_DECIMALS)
    if decimals < 0:
        return f"{round(value, decimals):.0f} ± {round(error, decimals):.0f}"
    return f"{value:.{decimals}f} ± {error:.{decimals}f}"
