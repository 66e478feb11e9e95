"""What the frames of a composite are measured to be, and what becomes of them over a sequence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from nlens_video.check.series import second_difference
from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.glb_writer import UInt8
from nlens_video.evaluate.metrics import psnr

BLOCK_PX = 4
"""Side of the squares over which errors are averaged where noise is not to count [px]."""

_FINE_PX, _COARSE_PX = 1.0, 4.0  # between which the object's detail is looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFigures:
    """One frame of a composite against the truth; nan where the object is out of view.

    Attributes:
        psnr_db: of code values within the object's reach [dB].
        block_psnr_db: of the means of squares of `BLOCK_PX` that lie wholly within it [dB].
        detail: logarithm of the mean detail within it [1].
        coc_rms_px: error of the CoC that the lens gives the object, nan where no lens is used [px].
    """

    psnr_db: float
    block_psnr_db: float
    detail: float
    coc_rms_px: float


def frame_figures(picture: UInt8, truth: UInt8, reach: Bool, coc_rms_px: float) -> FrameFigures:
    """Measure one frame.

    Args:
        picture: code values (H, W, 3).
        truth: code values (H, W, 3).
        reach: where the truth is given (H, W).
        coc_rms_px: error of the object's CoC [px].
    """
    if not reach.any():
        return FrameFigures(
            psnr_db=math.nan, block_psnr_db=math.nan, detail=math.nan, coc_rms_px=math.nan
        )
    luma = picture.astype(np.float32).mean(axis=2)
    fine, coarse = (cv2.GaussianBlur(luma, (0, 0), sigma) for sigma in (_FINE_PX, _COARSE_PX))
    return FrameFigures(
        psnr_db=psnr(picture[reach], truth[reach]),
        block_psnr_db=_block_psnr(picture, truth, reach),
        detail=math.log(max(float(np.abs(fine - coarse)[reach].mean()), 1e-3)),
        coc_rms_px=coc_rms_px,
    )


def coc_rms(fit: LensFit | None, true: LensFit, disparity: Float32) -> float:
    """Error of the CoC of pixels of some disparities (n,), nan for no lens or no pixel [px]."""
    if fit is None or not disparity.size:
        return math.nan
    return float(np.sqrt(np.mean(np.square(fit.coc_px(disparity) - true.coc_px(disparity)))))


def over_sequence(frames: list[FrameFigures], reference: list[FrameFigures]) -> dict[str, float]:
    """The frames of a composite beside those of the one that knows the lens.

    Args:
        frames: in order, at least one with the object in view.
        reference: of the same frames.
    """
    values, blocks = series(frames, "psnr_db"), series(frames, "block_psnr_db")
    with np.errstate(invalid="ignore"):  # two frames that are equal to the truth
        gap = series(reference, "psnr_db") - values
        block_gap = series(reference, "block_psnr_db") - blocks
    restless, calm = (_flicker(series(one, "detail")) for one in (frames, reference))
    return {
        "psnr_db": _over(np.mean, values),
        "gap_db": _over(np.max, gap),
        "gap_spread_db": _over(np.std, gap),
        "spread_db": _over(np.std, values),
        "flicker_percent": 100.0 * restless,
        "more_flicker_percent": 100.0 * (restless / calm - 1.0) if calm else math.nan,
        "block_psnr_db": _over(np.mean, blocks),
        "block_gap_db": _over(np.max, block_gap),
        "object_rms_px": _over(np.mean, series(frames, "coc_rms_px")),
    }


def series(frames: list[FrameFigures], name: str) -> Float64:
    """One figure of all frames (n,)."""
    return np.array([getattr(frame, name) for frame in frames], np.float64)


def _block_psnr(picture: UInt8, truth: UInt8, reach: Bool) -> float:
    """PSNR of the means of squares that lie wholly within the reach; nan where there is none."""
    rows, columns = (length // BLOCK_PX for length in reach.shape)
    part = np.s_[: rows * BLOCK_PX, : columns * BLOCK_PX]
    squares = (rows, BLOCK_PX, columns, BLOCK_PX)
    inside = reach[part].reshape(squares).all(axis=(1, 3))
    if not inside.any():
        return math.nan
    error = picture[part].astype(np.float64) - truth[part]
    error = error.reshape(*squares, 3).mean(axis=(1, 3))[inside]
    mean = float(np.mean(error**2))
    return 10.0 * math.log10(255.0**2 / mean) if mean else math.inf


def _flicker(detail: Float64) -> float:
    """Root mean square of how far each frame's detail lies off its neighbours' mean [1]."""
    bent = second_difference(detail)[1:-1]
    return math.sqrt(_over(np.mean, bent**2))


def _over(one_of: Callable[[Float64], np.floating[Any]], values: Float64) -> float:
    """One of the values that are numbers; nan where none is."""
    known = values[np.isfinite(values)]
    return float(one_of(known)) if known.size else math.nan
