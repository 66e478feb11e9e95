"""Noise of display-coded values, as light that a premultiplied layer brings along."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from nlens_video.core.color import transfer
from nlens_video.core.layers import Float32

_STEPS = 4096
_SRGB = transfer("iec61966-2-1")


def to_code(linear: Float32) -> Float32:
    """Display-coded sRGB of scene-linear light."""
    return _SRGB.to_coded(linear.astype(np.float64)).astype(np.float32)


def to_linear(code: Float32) -> Float32:
    """Scene-linear light of display-coded sRGB."""
    return _SRGB.to_linear(code.astype(np.float64)).astype(np.float32)


@lru_cache(maxsize=1)
def _tables() -> tuple[Float32, Float32]:
    """Codes by the root of the light, light by code, each over [0, 1]."""
    at = np.linspace(0.0, 1.0, _STEPS + 1)
    return to_code((at * at).astype(np.float32)), to_linear(at.astype(np.float32))


def regrain(rgba: Float32, plate: Float32, noise: Float32, deviation: Float32) -> Float32:
    """Add noise to a layer, so that its composite is as noisy as the plate.

    A plate that shows through by t = 1 - alpha brings t of its noise; what is missing has the
    deviation sqrt(1 - t^2) times the plate's at the composite's level. Light beyond white stays.

    Args:
        rgba: premultiplied scene-linear layer (h, w, 4).
        plate: scene-linear light below it (h, w, 3).
        noise: of unit deviation (h, w, 3).
        deviation: of the plate at 256 levels from black to white (256, 3) [sRGB code].

    Returns:
        The layer with its noise (h, w, 4); colour may be a little below 0. Pixels without alpha
        stay as they are.
    """
    out = np.array(rgba, np.float32, order="C")
    codes, lights = _tables()
    _regrain(
        out, np.ascontiguousarray(plate), np.ascontiguousarray(noise, np.float32),
        np.ascontiguousarray(deviation), codes, lights,
    )  # fmt: skip
    return out


# Compiled for the types of the signature below, which annotations would only repeat.
@njit(inline="always")
def _look_up(table, at):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    place = at * np.float32(table.shape[0] - 1)
    low = min(int(place), table.shape[0] - 2)
    part = place - np.float32(low)
    return table[low] + part * (table[low + 1] - table[low])


@njit(
    "void(f4[:,:,::1], f4[:,:,::1], f4[:,:,::1], f4[:,::1], f4[::1], f4[::1])",
    cache=True,
    nogil=True,
)
def _regrain(out, plate, noise, deviation, codes, lights):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    zero, one = np.float32(0.0), np.float32(1.0)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            alpha = min(out[i, j, 3], one)
            if alpha <= zero:
                continue
            free = one - alpha
            missing = np.sqrt(one - free * free)
            for c in range(3):
                light = out[i, j, c] + free * plate[i, j, c]
                if light >= one:
                    continue
                code = _look_up(codes, np.sqrt(max(light, zero)))
                level = np.float32(255.0) * code
                low = min(int(level), 254)
                part = level - np.float32(low)
                spread = deviation[low, c] + part * (deviation[low + 1, c] - deviation[low, c])
                grained = min(max(code + missing * spread * noise[i, j, c], zero), one)
                out[i, j, c] += _look_up(lights, grained) - max(light, zero)


def reference(rgba: Float32, plate: Float32, noise: Float32, deviation: Float32) -> Float32:
    """`regrain`, written down as it is meant."""
    alpha = np.minimum(rgba[..., 3:], 1.0)
    light = rgba[..., :3] + (1.0 - alpha) * plate
    code = to_code(np.maximum(light, 0.0))
    levels = np.linspace(0.0, 1.0, 256)
    spread = np.stack([np.interp(code[..., c], levels, deviation[:, c]) for c in range(3)], axis=2)
    missing = np.sqrt(1.0 - (1.0 - alpha) ** 2)
    grained = np.clip(code + missing * spread * noise, 0.0, 1.0).astype(np.float32)
    change = to_linear(grained) - np.maximum(light, 0.0)
    changed = (alpha > 0.0) & (light < 1.0)
    return np.concatenate(
        [rgba[..., :3] + np.where(changed, change, 0.0), rgba[..., 3:]], axis=2
    ).astype(np.float32)
