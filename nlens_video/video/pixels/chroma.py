"""Chroma of another subsampling: interpolated to the size of luma, and filtered down."""

from __future__ import annotations

import cv2
import numpy as np
from msgspec.structs import replace

from nlens_video.video.pixels.samples import Axis, Plane, Samples

_FULL = Axis()


def with_full_chroma(samples: Samples) -> Samples:
    """The same picture with chroma at every pixel, linear between its samples and where they lie.

    The planes of luma and alpha are shared, and so is chroma that has every pixel.
    """
    return with_chroma(samples, _FULL, _FULL)


def with_chroma(samples: Samples, across: Axis, down: Axis) -> Samples:
    """The same picture with chroma of another subsampling, filtered from chroma at every pixel.

    Along an axis whose subsampling stays, chroma stays.

    Args:
        samples: a picture; of float32 where chroma is to be filtered.
        across: subsampling along a row, without phase.
        down: subsampling along a column, likewise.
    """
    if (samples.across, samples.down) == (across, down):
        return samples
    height, width = samples.planes[0].shape
    rows, columns = samples.planes[1].shape
    places = np.eye(2, 3)  # of chroma samples, from those of pixels
    for row, (own, other) in enumerate(((samples.across, across), (samples.down, down))):
        if own != other:
            places[row, (row, 2)] = 1.0 / own.step, -_middle_px(own) / own.step
    stays = samples.across == across, samples.down == down
    size = columns if stays[0] else width, rows if stays[1] else height
    filters = _FULL if stays[0] else across, _FULL if stays[1] else down

    def moved(plane: Plane) -> Plane:
        if (columns, rows) != size:
            plane = cv2.warpAffine(
                np.ascontiguousarray(plane), places, size,
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
        return plane if filters == (_FULL, _FULL) else _filtered(plane, *filters)

    luma, blue, red = samples.planes
    return replace(samples, planes=(luma, moved(blue), moved(red)), across=across, down=down)


def _filtered(plane: Plane, across: Axis, down: Axis) -> Plane:
    """Samples of two axes without phase, from those at every pixel."""
    whole = cv2.sepFilter2D(
        plane, cv2.CV_32F, np.array(across.weights), np.array(down.weights),
        anchor=(-across.first, -down.first), borderType=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    return np.asarray(whole[:: down.step, :: across.step])


def _middle_px(axis: Axis) -> float:
    """Where the first chroma sample lies: in the middle of its filter [px]."""
    return axis.first - axis.phase + 0.5 * (len(axis.weights) - 1)
