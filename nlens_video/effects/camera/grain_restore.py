"""Grain of a darkened plate: the noise that is missing at its new level.

A shadow multiplies the plate with its noise. By a share s of the light, noise of the deviation n(L)
of scene-linear light L becomes s n(L), where the plate itself has n(s L). The missing part is
independent of it, of the variance n(s L)^2 - (s n(L))^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32, Int64, Picture
from nlens_video.effects.camera.grain import GrainModel, to_linear

_LEAST_LOSS = 0.1  # share of the light, below which a twentieth of the noise is missing
_FULL_LOSS = 0.2  # from which on it is added in full
_STEP = 4  # the level of the light is read on pixels so many times larger
_DARKEST = np.float32(1e-6)  # light that is still multiplied [1]
# a layer's colours to the share of the plate's light that it leaves: 1 - alpha + colour
_LEFT = np.hstack([np.eye(4), np.ones((4, 1))]) - np.outer(np.ones(4), (0, 0, 0, 1, 0))


@dataclass(frozen=True, slots=True, eq=False)
class _Darkened:
    """Where a layer takes so much light that its noise is missed.

    Attributes:
        layer: that darkens the plate.
        box: where the arrays lie.
        few_left: the share on coarse pixels (h', w', 3).
        few_share: of the missing noise that is added there (h', w', 1).
    """

    layer: BlurredLayer
    box: Box
    few_left: Float32
    few_share: Float32


class RestoreGrain:
    """Adds the noise that a darkened plate misses to the layer that darkens it.

    Args:
        model: of the plate.
        draw: number among the layers of a frame, whose noise is independent.
    """

    def __init__(self, model: GrainModel, draw: int) -> None:
        self._model, self._draw = model, draw
        self._deviation = light_deviation(model.curve)
        self._last: _Darkened | None = None  # reused while the shadow rests

    def __call__(self, picture: Picture, darkening: BlurredLayer, index: int) -> BlurredLayer:
        """Grain one frame.

        Args:
            picture: the plate; unchanged.
            darkening: layer whose colours are multiples of the plate's light.
            index: of the frame, which the noise depends on.
        """
        if self._last is None or self._last.layer is not darkening:
            self._last = _darkened(darkening)
        at = self._last
        if at.box.empty:
            return darkening
        plate = picture.linear(at.box)
        rows, columns = at.few_left.shape[:2]
        few = np.asarray(
            cv2.resize(plate, (columns, rows), interpolation=cv2.INTER_AREA), np.float32
        )
        amount = np.zeros((rows, columns, 4), np.float32)
        amount[..., :3] = at.few_share * missing_noise(few, at.few_left, self._deviation)
        # four channels throughout: NumPy is slow on a part of them
        noise = cv2.cvtColor(self._model.unit_noise(at.box, index, self._draw), cv2.COLOR_RGB2RGBA)
        added = cv2.multiply(noise, cv2.resize(amount, (at.box.width, at.box.height)))
        rgba = darkening.rgba.copy()
        rgba[at.box.slices_in(darkening.box)] += added
        return BlurredLayer(box=darkening.box, rgba=rgba)


def light_deviation(curve: Float32) -> Float32:
    """Deviation of scene-linear light (256, 3) at even steps of its root.

    Args:
        curve: deviation at 256 levels of sRGB code from black to white (256, 3) [sRGB code].
    """
    codes = np.linspace(0.0, 1.0, len(curve))
    light = to_linear(codes.astype(np.float32)).astype(np.float64)
    in_light = curve * np.gradient(light, codes)[:, None]
    roots = np.sqrt(light)
    return np.stack([np.interp(codes, roots, in_light[:, c]) for c in range(3)], axis=1).astype(
        np.float32
    )


def missing_noise(light: Float32, left: Float32, deviation: Float32) -> Float32:
    """Deviation (h, w, 3) of the noise that a darkened plate misses, as a share of its light.

    Args:
        light: of the plate, scene-linear (h, w, 3).
        left: share of it that is left, in [0, 1] (h, w, 3).
        deviation: as `light_deviation` gives it.
    """
    flat = deviation.ravel()  # NumPy takes from one axis much faster
    held = left * flat.take(_places(light))
    wanted = flat.take(_places(left * light))
    missing = np.sqrt(np.maximum(wanted * wanted - held * held, np.float32(0.0)))
    # noise is no larger than the light
    return np.asarray(np.minimum(missing / np.maximum(light, _DARKEST), 1.0), np.float32)


def _places(light: Float32) -> Int64:
    """Flat places in a table (256, 3) of the nearest of 256 even steps of the root of light."""
    root = np.sqrt(np.minimum(np.maximum(light, np.float32(0.0)), np.float32(1.0)))
    steps = (np.float32(255.0) * root + np.float32(0.5)).astype(np.int64)
    return steps * 3 + np.arange(3)


def _darkened(darkening: BlurredLayer) -> _Darkened:
    loss = cv2.extractChannel(darkening.rgba, 3)
    x, y, width, height = cv2.boundingRect((loss > _LEAST_LOSS).astype(np.uint8))
    box = Box(x, y, x + width, y + height).moved(darkening.box.x0, darkening.box.y0)
    if box.empty:
        nothing = np.zeros((0, 0, 4), np.float32)
        return _Darkened(darkening, box, nothing[..., :3], nothing[..., :1])
    inside = box.slices_in(darkening.box)
    left = np.asarray(cv2.transform(darkening.rgba[inside], _LEFT), np.float32)
    share = np.clip((loss[inside] - _LEAST_LOSS) / (_FULL_LOSS - _LEAST_LOSS), 0.0, 1.0)
    few = -(-width // _STEP), -(-height // _STEP)
    few_left, few_share = (
        np.asarray(cv2.resize(values, few, interpolation=cv2.INTER_AREA), np.float32)
        for values in (left, share)
    )
    return _Darkened(darkening, box, few_left[..., :3], few_share[..., None])
