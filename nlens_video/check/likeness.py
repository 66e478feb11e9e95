"""How the plate as a whole lies in its result: shifted, blurred, sharpened, or of other colours.

What encoding does to textured blocks is far below these limits up to H.264 at crf 28; the limits
grow with its noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.check.frames import BLOCK_PX, Pair
from nlens_video.check.regions import Mask
from nlens_video.core.layers import Bool, Float64

_TEXTURED = 4.0  # detail of a block that grain and encoding do not make [level]
_LEAST_BLOCKS = 100
_SOFT_PX = 1.5  # standard deviation of the low-pass in which both are registered
_SHIFT_PX = 0.25
_DETAIL, _DETAIL_OF_NOISE = 0.08, 0.03  # change of the log of the detail, and more by noise [1]
_COLOUR, _COLOUR_OF_NOISE = 0.5, 0.25  # root mean square, and more by noise [level]

_Kind = Literal["colours", "detail", "shift"]
WORDS: dict[_Kind, Callable[[float], str]] = {
    "shift": lambda px: f"lies {px:.2f} px beside its place (limit {_SHIFT_PX} px)",
    "detail": lambda log: f"has {math.expm1(log):+.0%} detail: it is blurred or sharpened",
    "colours": lambda level: (
        f"has other colours by {level:.1f} of 255 levels, as by another matrix"
    ),
}


class Likeness(Struct, frozen=True):
    """What the plate's textured blocks became; nothing where they are too few.

    Attributes:
        shift_px: by which they lie beside their place [px].
        detail: log of the share of detail that is left [1].
        colours: what luma and both colour differences take of each other, root mean square [level].
    """

    shift_px: float = 0.0
    detail: float = 0.0
    colours: float = 0.0


class Fault(Struct, frozen=True):
    """The first kind of fault of a frame, which brings about the others, and its size."""

    kind: _Kind
    size: float


def likeness(pair: Pair, plate: Mask) -> Likeness:
    """Compare the plate's textured blocks among some (h, w)."""
    away = cv2.erode(plate.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0  # beyond the band-pass
    blocks = away & (pair.plate.detail > _TEXTURED)
    if blocks.sum() < _LEAST_BLOCKS:
        return Likeness()
    left = float(pair.result.detail[blocks].sum()) / float(pair.plate.detail[blocks].sum())
    before, after = pair.plate.colour[blocks], pair.result.colour[blocks]
    spread = np.asarray(before - before.mean(axis=0), np.float64)
    change = (after - before) - (after - before).mean(axis=0)
    mixing = np.linalg.lstsq(spread, change, rcond=None)[0]
    mixing *= 1.0 - np.eye(len(mixing))  # blur reduces each by itself
    mixed = spread @ mixing
    return Likeness(
        shift_px=float(np.linalg.norm(_shift(pair, blocks))),
        detail=math.log(max(left, 1e-3)),
        colours=float(np.sqrt(np.square(mixed).mean(axis=0)).max()),
    )


def fault(one: Likeness, noise: float) -> Fault | None:
    """What is wrong with a frame's plate, None where nothing is.

    Args:
        one: of the frame.
        noise: median difference of its blocks [level].
    """
    if one.shift_px > _SHIFT_PX:
        return Fault("shift", one.shift_px)
    if one.colours > _COLOUR + _COLOUR_OF_NOISE * noise:
        return Fault("colours", one.colours)
    if abs(one.detail) > _DETAIL + _DETAIL_OF_NOISE * noise:
        return Fault("detail", one.detail)
    return None


def _shift(pair: Pair, blocks: Bool) -> Float64:
    """How far right and down the result lies, (2,), by least squares [px]."""
    cells = blocks.repeat(BLOCK_PX, 0).repeat(BLOCK_PX, 1)
    rows, columns = cells.shape
    plate, result = (
        cv2.GaussianBlur(one.luma, (0, 0), _SOFT_PX)[:rows, :columns]
        for one in (pair.plate, pair.result)
    )
    slopes = [np.gradient(0.5 * (plate + result), axis=axis)[cells] for axis in (1, 0)]
    off = (plate - result)[cells]
    steep = np.stack(slopes).astype(np.float64)
    return np.asarray(np.linalg.lstsq(steep.T, off - off.mean(), rcond=None)[0], np.float64)
