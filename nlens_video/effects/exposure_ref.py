"""How the light of two small pictures compares, in the obvious way: defines `exposure`."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.effects.exposure_kernels import BRIGHTEST, DARKEST


def stops(light: Float32) -> Float64:
    """Logarithmic light (h, w, 3), NaN where a channel is too dark or too bright."""
    lost = (light.min(axis=2) < DARKEST) | (light.max(axis=2) > BRIGHTEST)
    return np.where(lost[..., None], np.nan, np.log2(np.maximum(light, 1e-6, dtype=np.float64)))


def change(before: Float32, now: Float32, least_share: float, most_spread: float) -> Float64 | None:
    """Median (3,) of the change from one picture to another; None where it tells nothing.

    Args:
        before: stops of the one (h, w, 3).
        now: stops of the other.
        least_share: of the picture that must be known in both [1].
        most_spread: median deviation from which on it is not the same in most places.
    """
    ratio = (now - before).reshape(-1, 3)
    known = ratio[np.isfinite(ratio).all(axis=1)]
    if len(known) < least_share * len(ratio):
        return None
    middle = np.sort(known, axis=0)[len(known) // 2]
    spread = np.sort(np.abs(known - middle), axis=0)[len(known) // 2]
    return middle.astype(np.float64) if spread.max() < most_spread else None
