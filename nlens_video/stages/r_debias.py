"""Removes the training prior from CoC estimates before they enter the regression.

The network gives the posterior median, which shrinks towards the training mean where a picture
holds little evidence. That is right for one pixel, but a line through thousands of shrunken values
is too flat. Prior and posterior are about normal in log(1 + CoC), so dividing out the prior undoes
the shrinkage: precisions subtract, as do means weighted by them.
"""

from __future__ import annotations

import math

import numpy as np

from nlens_video.core.layers import CocPrior, Float64

_MOST_SHRUNK = 0.8  # a posterior this wide, as a share of the prior's width, holds no evidence
_LAPLACE = math.sqrt(2.0)  # deviation of a Laplace distribution by its mean absolute error


def remove_prior(coc_px: Float64, sigma_px: Float64, prior: CocPrior) -> tuple[Float64, Float64]:
    """Divide the prior out of posterior estimates.

    Args:
        coc_px: estimated unsigned CoC diameter (N,) [px of the frame].
        sigma_px: its expected absolute error (N,) [px of the frame].
        prior: distribution of CoC in training.

    Returns:
        Diameter and expected absolute error (N,) of the likelihood alone [px of the frame].
    """
    coc, sigma = coc_px / prior.scale, sigma_px / prior.scale
    wide = _LAPLACE * sigma / (1 + coc)
    share = np.minimum(wide / prior.deviation, _MOST_SHRUNK) ** 2
    log_coc = np.log1p(coc)
    log_coc = log_coc + (log_coc - prior.mean) * share / (1 - share)
    debiased = np.expm1(np.maximum(log_coc, 0.0))
    error = sigma * (1 + debiased) / (1 + coc) / np.sqrt(1 - share)
    return debiased * prior.scale, error * prior.scale
