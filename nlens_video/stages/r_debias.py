"""From what the network believes to what the picture says.

The network answers with the median of what it believes after seeing a picture: where the picture
says little, that is drawn towards the blur of an average training picture. One pixel is best read
so, but a line through thousands of such answers comes out too flat, as any regression on shrunken
values does. Both beliefs are about normal in log(1 + CoC), so the pull can be taken back:
precisions subtract, as do means weighted by them.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import CocPrior, Float64

_LEAST_SAID = 0.8  # a belief as wide as this share of the prior's width says nothing of its own
_LAPLACE = math.sqrt(2.0)  # deviation of a Laplace distribution by its mean absolute error


def remove_prior(coc_px: Float64, sigma_px: Float64, prior: CocPrior) -> tuple[Float64, Float64]:
    """Take the training pictures' pull back from an estimate.

    Args:
        coc_px: estimated unsigned CoC diameter (N,) [px of the frame].
        sigma_px: its expected absolute error (N,) [px of the frame].
        prior: what the estimator was trained on.

    Returns:
        Diameter and expected absolute error (N,) that the picture alone gives [px of the frame].
    """
    coc, sigma = coc_px / prior.scale, sigma_px / prior.scale
    wide = _LAPLACE * sigma / (1 + coc)
    share = np.minimum(wide / prior.deviation, _LEAST_SAID) ** 2
    log_coc = np.log1p(coc)
    log_coc = log_coc + (log_coc - prior.mean) * share / (1 - share)
    said = np.expm1(np.maximum(log_coc, 0.0))
    error = sigma * (1 + said) / (1 + coc) / np.sqrt(1 - share)
    return said * prior.scale, error * prior.scale
