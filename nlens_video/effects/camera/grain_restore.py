"""Grain of a darkened plate: the noise that is missing at its new level.

A shadow multiplies the plate with its noise. By a share s of the light, noise of the deviation n(L)
of scene-linear light L becomes s n(L), where the plate itself has n(s L). The missing part is
independent of it, of the variance n(s L)^2 - (s n(L))^2.
"""

from __future__ import annotations

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32, Picture
from nlens_video.effects.camera.grain import GrainModel
from nlens_video.effects.camera.grain_code import SDR, GrainCode
from nlens_video.kernels.thread_pool import Band, parallel_for, picture_bands
from nlens_video.native import kernels

_LEAST_LOSS = 0.1  # share of the light, below which a twentieth of the noise is missing
_FULL_LOSS = 0.2  # from which on it is added in full
_DARKEST = 1e-6  # light that is still multiplied, as in the kernel [1]


class RestoreGrain:
    """Adds the noise that a darkened plate misses to the layer that darkens it.

    Args:
        model: of the plate.
        draw: number among the layers of a frame, whose noise is independent.
    """

    def __init__(self, model: GrainModel, draw: int) -> None:
        self._model, self._draw = model, draw
        self._deviation = light_deviation(model.curve, model.code)
        self._last: tuple[BlurredLayer, Box] | None = None  # reused while the shadow rests

    def __call__(self, picture: Picture, darkening: BlurredLayer, index: int) -> BlurredLayer:
        """Grain one frame.

        Args:
            picture: the plate; unchanged.
            darkening: layer whose colours are multiples of the plate's light.
            index: of the frame, which the noise depends on.
        """
        if self._last is None or self._last[0] is not darkening:
            self._last = darkening, _dark_box(darkening)
        box = self._last[1]
        if box.empty:
            return darkening
        rgba = darkening.rgba.copy()
        part = rgba[box.slices_in(darkening.box)]
        noise = self._model.unit_noise(box, index, self._draw)
        plate = self._model.code.normalised(picture.linear(box))
        restore_grain(part, plate, noise, self._deviation)
        return BlurredLayer(box=darkening.box, rgba=rgba)


def light_deviation(curve: Float32, code: GrainCode = SDR) -> Float32:
    """Deviation of scene-linear light (3, S) at even steps of its root, by the largest light.

    Args:
        curve: deviation at levels from black to the end of a code (N, 3) [code].
        code: of these levels.
    """
    codes = np.linspace(0.0, code.end, len(curve))
    light = code.normalised(code.to_linear(codes.astype(np.float32))).astype(np.float64)
    in_light = curve * np.gradient(light, codes)[:, None]
    roots = np.sqrt(light)
    steps = np.linspace(0.0, 1.0, round(len(curve) * code.top**0.5))
    return np.stack([np.interp(steps, roots, in_light[:, c]) for c in range(3)]).astype(np.float32)


def restore_grain(rgba: Float32, plate: Float32, noise: Float32, deviation: Float32) -> None:
    """Add the noise that a darkened plate misses, in place.

    It is a share of the light and no larger than it, sets in where a tenth of the light is lost,
    and is whole where a fifth is.

    Args:
        rgba: layer whose colours are multiples of the plate's light (h, w, 4); may be a part of a
            wider one.
        plate: light below it, by the largest of the code (h, w, 3).
        noise: of unit deviation (h, w, 3).
        deviation: as `light_deviation` gives it.
    """

    def add(band: Band) -> None:
        part = slice(*band)
        kernels.restore_grain(
            rgba[part], plate[part], noise[part], deviation, _LEAST_LOSS, _FULL_LOSS
        )

    parallel_for(add, picture_bands(*rgba.shape[:2]))


def restore_grain_reference(
    rgba: Float32, plate: Float32, noise: Float32, deviation: Float32
) -> Float32:
    """NumPy reference of `restore_grain`; returns the layer with that noise (h, w, 4)."""
    levels = np.linspace(0.0, 1.0, deviation.shape[1])

    def spread(light: Float32) -> Float32:
        roots = np.sqrt(np.clip(light, 0.0, 1.0))
        return np.stack([np.interp(roots[..., c], levels, deviation[c]) for c in range(3)], axis=2)

    loss, light = rgba[..., 3:], np.clip(plate, 0.0, 1.0)
    left = 1.0 - loss + rgba[..., :3]
    held, wanted = left * spread(light), spread(left * light)
    missing = np.sqrt(np.maximum(wanted * wanted - held * held, 0.0))
    share = np.clip((loss - _LEAST_LOSS) / (_FULL_LOSS - _LEAST_LOSS), 0.0, 1.0)
    added = share * np.minimum(missing / np.maximum(light, _DARKEST), 1.0) * noise
    return np.concatenate([rgba[..., :3] + added, loss], axis=2).astype(np.float32)


def _dark_box(darkening: BlurredLayer) -> Box:
    """Where the layer takes so much light that noise is missed."""
    if darkening.box.empty:
        return darkening.box
    lost = (cv2.extractChannel(darkening.rgba, 3) > _LEAST_LOSS).astype(np.uint8)
    x, y, width, height = cv2.boundingRect(lost)
    return Box(x, y, x + width, y + height).translated(darkening.box.x0, darkening.box.y0)
