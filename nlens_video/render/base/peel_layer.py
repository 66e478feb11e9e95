"""Depth peeling: the front surfaces as limits, and the picture of what they hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float32

_ALL = 2.0  # window depth beyond everything


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontSurfaces:
    """Nearest surfaces of a picture, on the region that is peeled.

    Attributes:
        depth: of them (height, width), +inf where nothing is [scene unit].
        disparity_step: how much less disparity what lies behind them has, > 0 [1 / scene unit].
        corner: column and row of the other picture's first pixel in this one [px].
    """

    depth: Float32
    disparity_step: float
    corner: tuple[int, int]

    def step(self, near: float, far: float) -> float:
        """The step as window depth, which is affine in disparity."""
        return self.disparity_step * near * far / (far - near)

    def limit(self, near: float, far: float) -> Float32:
        """Window depth (height, width) from which a surface lies behind; beyond all where none."""
        there = np.isfinite(self.depth)
        disparity = np.divide(1.0, self.depth, where=there, out=np.zeros(there.shape))
        window = (1.0 - near * disparity) * (far / (far - near)) + self.step(near, far)
        return np.where(there, window, _ALL).astype(np.float32)

    def most_disparity(self) -> Float32:
        """Disparity (height, width) up to which a surface lies behind; 0 where nothing does."""
        there = np.isfinite(self.depth)
        disparity = np.divide(1.0, self.depth, where=there, out=np.zeros(there.shape))
        return np.maximum(disparity - self.disparity_step, 0.0).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BehindPicture:
    """What a picture's nearest surface hides.

    Attributes:
        rgba: premultiplied linear colour and alpha (height, width, 4).
        depth: along the optical axis (height, width), +inf where nothing is [scene unit].
        front_rgba: what the nearest surface alone gives to each pixel (height, width, 4).
    """

    rgba: Float32
    depth: Float32
    front_rgba: Float32
