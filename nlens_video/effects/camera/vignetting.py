"""Vignetting: radial falloff of light, measured on the plate, applied to the object.

Measured: a lens is radially symmetric. The slope of the (logarithmic) light along the radius
follows the same curve in every direction, where the scene's own slopes are as often up as down
(Zheng et al. 2008, Single-Image Vignetting Correction Using Radial Gradient Symmetry). It counts
only where all quadrants agree beyond the smooth shapes that scenes have; a scene that is bright in
the middle and dark around looks the same and cannot be distinguished.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from nlens_video.core.box import square_radius
from nlens_video.core.layers import BlurredLayer, Box, Float32, Float64, Picture, clips_at
from nlens_video.core.optics import Vignetting
from nlens_video.effects.camera.radial_fit import Windows, fit_radial
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.plate_pictures import PlatePictures

EFFECT = "vignetting"
THRESHOLD_STOPS = 0.2
LEAST_RATIO = 8.0  # of the lens' shape to those of scenes
_CELLS = 48  # across the picture
_LEAST_CELLS = 3  # down it, of which the middle ones have slopes
_DARKEST = 0.004  # light below which noise decides [1]
_BRIGHTEST = 0.95  # of the light at which the plate clips [1]
_MS_PER_MEGAPIXEL = 12.0


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on the first of a shot's pictures."""
    picture = pictures[0]
    light = PlatePictures.of(pictures).light()
    brightest = _BRIGHTEST * clips_at(light, picture.peak)
    fit = fit_radial(_slopes(light, brightest), corner=(0.5, 0.25))
    scene = float(np.sqrt(np.mean(np.square(fit.others)))) if fit.others else math.inf
    model = None
    if fit.consistent and fit.at_corner > LEAST_RATIO * scene:
        model = Vignetting(square=0.5 * fit.linear, fourth=0.25 * fit.cubic)
    evidence = (
        f"loss of light by radius: {fit.at_corner:.2f} stops at the corner ({fit.describe()}), "
        f"other shapes of the scene {scene:.2f} stops"
    )
    return Measurement(
        effect=EFFECT,
        value=0.0 if model is None else model.at_corner_stops,
        threshold=THRESHOLD_STOPS,
        unit="stops at the corner",
        evidence=evidence,
        model=model,
        cost_ms=_MS_PER_MEGAPIXEL * 0.2 * picture.width * picture.height / 1e6,
    )


def _slopes(light: Float32, brightest: float) -> Windows:
    """Slope of the light in each cell of a coarse grid, in stops by half diagonal.

    Args:
        light: of the plate (H, W).
        brightest: light beyond which it may clip.
    """
    side = max(1, min(light.shape[1] // _CELLS, light.shape[0] // _LEAST_CELLS))
    height, width = (length // side for length in light.shape)

    def averaged(values: Float32) -> Float64:
        whole = values[: height * side, : width * side]
        small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.float64)

    cells = averaged(np.log2(np.maximum(light, _DARKEST)))
    clipped = averaged(((light < _DARKEST) | (light > brightest)).astype(np.float32))
    half = 0.5 * math.hypot(width, height)
    across = 0.5 * (cells[1:-1, 2:] - cells[1:-1, :-2]) * half
    down = 0.5 * (cells[2:, 1:-1] - cells[:-2, 1:-1]) * half
    x, y = np.meshgrid(
        (np.arange(1, width - 1) + 0.5 - 0.5 * width) / half,
        (np.arange(1, height - 1) + 0.5 - 0.5 * height) / half,
    )
    told = cv2.dilate(clipped, np.ones((3, 3), np.uint8))[1:-1, 1:-1] < 0.2
    count = int(told.sum())
    return Windows(
        x=x[told],
        y=y[told],
        moved=-np.stack([across[told], down[told]], axis=1),
        covariance=np.zeros((count, 2, 2)),
        trust=np.ones(count),
        others=_shapes(x[told], y[told]),
    )


def _shapes(x: Float64, y: Float64) -> Float64:
    """Gradients (N, 2, 6) of smooth shapes without radial symmetry, which only scenes have."""
    across = [2 * x, 2 * y, 3 * x**2 - 3 * y**2, 6 * x * y, 3 * x**2 + y**2, 2 * x * y]
    down = [-2 * y, 2 * x, -6 * x * y, 3 * x**2 - 3 * y**2, 2 * x * y, x**2 + 3 * y**2]
    return np.stack([np.stack(across, axis=1), np.stack(down, axis=1)], axis=1)


def vignette(layer: BlurredLayer, vignetting: Vignetting, frame: Box) -> BlurredLayer:
    """A premultiplied layer inside the frame with the lens' falloff of light; alpha is kept."""
    if layer.box.empty:
        return layer
    square = square_radius(layer.box, frame)
    loss = square * (np.float32(vignetting.square) + np.float32(vignetting.fourth) * square)
    rgba = layer.rgba.copy()
    rgba[..., :3] *= np.exp2(-loss)[..., None]
    return BlurredLayer(box=layer.box, rgba=rgba)
