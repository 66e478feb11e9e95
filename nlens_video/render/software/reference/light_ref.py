"""`light` by its definition: glTF 2.0, appendix B, one point at a time in float64."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A point of a surface: unit vectors (3,), linear colours (3,), factors in [0, 1]."""

    normal: Float64
    view: Float64
    base: Float64
    metallic: float
    roughness: float
    f0: Float64
    specular: float


def reflectance(surface: Surface, toward: Float64) -> Float64:
    """BRDF times cosine (3,) for light from a unit direction `toward` (3,) [1 / sr]."""
    cosine = float(surface.normal @ toward)
    if cosine <= 0.0:
        return np.zeros(3)
    half = (toward + surface.view) / np.linalg.norm(toward + surface.view)
    seen = max(abs(float(surface.normal @ surface.view)), 1e-4)
    alpha = max(surface.roughness**2, 0.002)
    grazing = (1.0 - float(np.clip(surface.view @ half, 0.0, 1.0))) ** 5
    shine = _distribution(max(float(surface.normal @ half), 0.0), alpha) * _visible(
        cosine, seen, alpha
    )
    fresnel = surface.f0 + (surface.specular - surface.f0) * grazing
    dielectric = (1.0 - fresnel.max()) * surface.base / math.pi + shine * fresnel
    metal = shine * (surface.base + (1.0 - surface.base) * grazing)
    mixed = (1.0 - surface.metallic) * dielectric + surface.metallic * metal
    return np.asarray(cosine * mixed)


def _distribution(cosine: float, alpha: float) -> float:
    """Of microfacets' normals (Trowbridge and Reitz)."""
    return alpha**2 / (math.pi * (cosine**2 * (alpha**2 - 1.0) + 1.0) ** 2)


def _visible(light: float, view: float, alpha: float) -> float:
    """Share of microfacets that light and eye both reach (Smith), over 4 times both cosines."""
    towards_eye = math.sqrt(view**2 * (1.0 - alpha**2) + alpha**2)
    towards_light = math.sqrt(light**2 * (1.0 - alpha**2) + alpha**2)
    return 0.5 / (light * towards_eye + view * towards_light)


def by_suns(surface: Surface, suns: Sequence[tuple[Float64, Float64]]) -> Float64:
    """Radiance (3,) under lamps without a place: directions towards them, and irradiances (3,)."""
    parts = [reflectance(surface, toward) * strength for toward, strength in suns]
    return np.asarray(np.sum(parts, axis=0))
