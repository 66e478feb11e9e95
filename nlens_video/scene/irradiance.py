"""How much light a horizontal ground gets from lamps and from around (KHR_lights_punctual)."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.scene.illumination import LUMINANCE, Illumination, Lamp

_AROUND = 2.5  # light from around by that of the strongest lamp, where no file tells it
_UP = np.array([0.0, 1.0, 0.0])


def reaches(lamp: Lamp, ground_y: float) -> bool:
    """Whether a lamp shines on a ground of that height from above."""
    if lamp.posed.light.kind == "directional":
        return bool(lamp.posed.direction[1] < 0.0)
    return bool(lamp.posed.position[1] > ground_y)


def from_lamp(lamp: Lamp, ground: Float64) -> Float64:
    """Irradiance (..., 3) of ground points (..., 3) by a lamp, as if nothing hid it."""
    light, direction = lamp.posed.light, lamp.posed.direction
    color = np.array(light.color) * light.intensity
    if light.kind == "directional":
        return np.broadcast_to(color * max(0.0, -float(direction[1])), ground.shape)
    toward = lamp.posed.position - ground
    distance2 = np.maximum((toward**2).sum(axis=-1), np.finfo(np.float64).tiny)
    unit = toward / np.sqrt(distance2)[..., None]
    strength = np.maximum(unit[..., 1], 0.0) / distance2
    if light.range is not None:
        strength = strength * np.clip(1.0 - (distance2 / light.range**2) ** 2, 0.0, 1.0)
    if light.kind == "spot":  # "Inner and Outer Cone Angles"
        inner, outer = math.cos(light.inner_cone), math.cos(light.outer_cone)
        part = (unit @ -direction - outer) / max(1e-3, inner - outer)
        strength = strength * np.clip(part, 0.0, 1.0) ** 2
    return np.asarray(strength[..., None] * color)


def from_around(light: Illumination, ground: Float64) -> Float64:
    """Irradiance (3,) of the ground at a point (3,) by all that is no lamp.

    Where nothing is known of it, it is taken for a multiple of what the strongest lamp gives beyond
    the others, which stand for such light. All together is white: a camera balances for that.
    """
    if light.ambient is not None:
        return light.irradiance_around(_UP)
    given = np.array([from_lamp(lamp, ground) for lamp in light.lamps]).reshape(-1, 3)
    strengths = given @ LUMINANCE
    strongest, all_ = float(strengths.max(initial=0.0)), float(strengths.sum())
    around = _AROUND * max(0.0, 2.0 * strongest - all_)
    return np.asarray(np.maximum(around + all_ - given.sum(axis=0), 0.0) * (around > 0.0))
