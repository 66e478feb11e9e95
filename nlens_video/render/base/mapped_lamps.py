"""Which lamps have a map of the object's depth, and how much of their light it may take."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.scene.illumination import Lamp, on_ball

_NEAREST = 0.05  # to the object's bounds, of lamps that have a map [its radius]
_FAINT, _PLAIN = 0.21, 0.25  # of the strongest lamp: up to here no map, from here for all of it


def mapped_lamps(lamps: Sequence[Lamp], bounds: Float64, most: int) -> dict[int, float]:
    """Numbers of the lamps that have a map, the strongest first.

    Args:
        lamps: at least one.
        bounds: of the object (2, 3) [scene unit].
        most: maps that there may be.

    Returns:
        The share of the lamp's light that its map may take, more than 0 and at most 1. It grows
        smoothly with the lamp's light, so that the shadow of a lamp that fades does not vanish at
        once.
    """
    middle, radius = bounds.mean(axis=0), 0.5 * float(np.linalg.norm(bounds[1] - bounds[0]))
    strengths = []
    for lamp in lamps:
        position = lamp.posed.position
        near = lamp.posed.light.kind != "directional"
        away = np.linalg.norm(position - np.clip(position, *bounds)) if near else math.inf
        strengths.append(on_ball(lamp, middle, radius) if away > _NEAREST * radius else 0.0)
    order = sorted(range(len(lamps)), key=lambda number: -strengths[number])[:most]
    shares = {number: _share(strengths[number], max(strengths)) for number in order}
    return {number: share for number, share in shares.items() if share > 0.0}


def _share(strength: float, strongest: float) -> float:
    if strongest <= 0.0:
        return 0.0
    part = min(max((strength / strongest - _FAINT) / (_PLAIN - _FAINT), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)
