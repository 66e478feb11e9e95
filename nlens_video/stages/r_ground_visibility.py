"""How much of the plate shows the ground plane, by how far off that is."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float64

BINS = 8
"""Parts of the plane, by its disparity, each of as many samples [1]."""

FLOOR_PX = 1.0
"""What an estimated CoC may be off by at least [px]."""

NONE, ALL = 0.25, 0.75
"""Shares of agreeing samples up to which nothing, and from which all, is taken for ground [1]."""


def ground_visibility(
    disparity: Float64, coc_px: Float64, sigma_px: Float64, expected_px: Float64
) -> tuple[tuple[float, float], ...]:
    """Where the plate is as blurred as the ground plane would be.

    A wall or whatever else stands on the plane hides what is farther off; from there on the plate
    disagrees, or it is as blurred and does no harm.

    Args:
        disparity: of the plane (N,), > 0 [1 / scene unit].
        coc_px: unsigned diameter as the plate shows it (N,) [px].
        sigma_px: its expected error (N,) [px].
        expected_px: unsigned diameter that the fit gives the plane (N,) [px].

    Returns:
        Pairs of a disparity, rising, and the share of ground there, 0 to 1.
    """
    off = np.abs(expected_px - coc_px) / np.maximum(sigma_px, FLOOR_PX)
    alike = np.clip(3.0 - off, 0.0, 1.0)
    order = np.argsort(disparity, kind="stable")
    pairs: list[tuple[float, float]] = []
    for part in np.array_split(order, BINS):
        if not part.size:
            continue
        at = float(disparity[part].mean())
        share = float(np.clip((alike[part].mean() - NONE) / (ALL - NONE), 0.0, 1.0))
        if not pairs or at > pairs[-1][0]:
            pairs.append((at, share))
    return tuple(pairs)
