"""The paper's regression (section 4.2): signs by a rule, then a least-squares line.

No small CoC within the footprint: all of it lies on one side of the focus, and the line through the
unsigned CoC tells which by its own slope. Otherwise what lies beyond the smallest CoC is negative.
How small is small is not stated there; `IN_FOCUS_PX` is ours.
"""

from __future__ import annotations

import numpy as np

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import CocMap, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.p_projection import GroundProjection

IN_FOCUS_PX = 2.0
_SMALLEST = 0.05  # the share of the samples whose CoC is looked at; one alone would be noise
_MIN_SAMPLES = 48


def fit_line(coc: CocMap, ground: GroundProjection, frame: int = 0) -> LensFit:
    """Fit the paper's line on the footprint of one frame.

    Args:
        coc: the plate's CoC (H, W); its sigma is not used.
        ground: footprint and plane on the same frame.
        frame: index of that frame, kept in the fit.

    Raises:
        LensFitError: too small a footprint, or a line that no lens has.
    """
    unsigned = coc.coc_px[ground.mask].astype(np.float64)
    disparity = ground.disparity[ground.mask]
    if len(unsigned) < _MIN_SAMPLES:
        raise LensFitError(f"{len(unsigned)} px of footprint, {_MIN_SAMPLES} are needed")
    smallest = unsigned <= np.quantile(unsigned, _SMALLEST)
    signed = unsigned
    if unsigned[smallest].max() < IN_FOCUS_PX:
        focus = np.median(disparity[smallest])
        signed = np.where(disparity < focus, -unsigned, unsigned)
        slope, intercept = _line(disparity, signed)
    else:
        slope, intercept = _line(disparity, signed)
        if slope < 0:  # the blur grows with the distance: all of it lies behind the focus
            slope, intercept, signed = -slope, -intercept, -unsigned
    residual = slope * disparity + intercept - signed
    height, width = coc.coc_px.shape
    return LensFit(
        slope=slope,
        intercept=intercept,
        rmse_px=float(np.sqrt(np.mean(residual**2))),
        n=len(unsigned),
        width=width,
        height=height,
        frame=frame,
        sign="assumed",
        method="the paper's rule and least-squares line on the footprint",
    )


def _line(disparity: Float64, coc: Float64) -> tuple[float, float]:
    design = np.stack([disparity, np.ones_like(disparity)], axis=1)
    slope, intercept = np.linalg.lstsq(design, coc, rcond=None)[0]
    return float(slope), float(intercept)
