"""Grain: the plate's noise, made again where the object covers it.

The part of the plate that still shows through brings its own noise along; the object gets what is
missing to the plate's at the level that the composite has there.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Float32, Picture
from nlens_video.effects.camera.grain_kernels import regrain, white_noise

LAGS = 3
"""How many pixels away noise may still hang together, each way."""

_PERSISTENT = 0.03  # a share of the noise that is left out of the past
_MOST_PAST = 12  # pictures of the past that the noise remembers
_SEED = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class GrainModel:
    """A plate's noise in display-coded values.

    Attributes:
        levels: code values at which `deviation` is known, increasing (B,) [sRGB code].
        deviation: of red, green and blue (B, 3) [sRGB code].
        mixing: how three independent parts make up the channels (3, 3), noise = mixing @ parts.
        kernels: spatial correlation of each part, of unit energy (3, 2 LAGS + 1, 2 LAGS + 1).
        persistence: share of the noise that comes back in the next picture, in [0, 1) [1].
    """

    levels: Float32
    deviation: Float32
    mixing: Float32
    kernels: Float32
    persistence: float


@dataclass(frozen=True, slots=True)
class AddGrain:
    """Adds grain to the object's layer, as much as the composite over the plate then shows."""

    model: GrainModel

    def __call__(self, picture: Picture, blurred: BlurredLayer, index: int) -> BlurredLayer:
        """Grain one frame.

        Args:
            picture: the plate, not composited yet; left as it is.
            blurred: the object as the lens sees it; left as it is.
            index: number of the frame, which the noise depends on.
        """
        if blurred.box.empty:
            return blurred
        plate = picture.linear(blurred.box)
        noise = self.unit_noise(blurred, index)
        return BlurredLayer(
            box=blurred.box, rgba=regrain(blurred.rgba, plate, noise, self._curve())
        )

    def unit_noise(self, blurred: BlurredLayer, index: int) -> Float32:
        """Noise (h, w, 3) of unit deviation at every level, on the layer's box."""
        box = blurred.box.expanded(LAGS)
        size = (box.height, box.width)
        shares = past_shares(self.model.persistence)
        parts = []
        for part, kernel in enumerate(self.model.kernels):
            white = np.zeros(size, np.float32)
            for back, share in enumerate(shares):
                field = white_noise((box.y0, box.x0), size, index - back, _SEED + part)
                white += np.float32(share) * field
            parts.append(cv2.filter2D(white, -1, kernel)[LAGS:-LAGS, LAGS:-LAGS])
        return np.stack(parts, axis=2) @ self.model.mixing.T

    def _curve(self) -> Float32:
        """Deviation at 256 levels (256, 3) [sRGB code]."""
        levels = np.linspace(0.0, 1.0, 256)
        model = self.model
        return np.stack(
            [np.interp(levels, model.levels, model.deviation[:, c]) for c in range(3)], axis=1
        ).astype(np.float32)


def past_shares(persistence: float) -> tuple[float, ...]:
    """How much each picture's white noise, from this one back, counts in this one's grain.

    An autoregressive process written as a sum, so that a frame needs no frame before it; the
    squares sum to 1.

    Args:
        persistence: correlation from picture to picture, in [0, 1) [1].
    """
    shares = [1.0]
    while len(shares) < _MOST_PAST and shares[-1] * persistence > _PERSISTENT:
        shares.append(shares[-1] * persistence)
    energy = sum(share * share for share in shares) ** 0.5
    return tuple(share / energy for share in shares)
