"""The floor: one CoC for the whole plate."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32


def best_constant(truth: Float32) -> Float32:
    """The constant map (H, W) with the least RMSE against a true CoC (H, W), its mean [px].

    It is taken from the truth: an estimate has to beat it before it says anything about the plate.
    """
    return np.full(truth.shape, truth.mean(), np.float32)
