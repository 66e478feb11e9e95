"""Chroma at the size of luma, as conversions to RGB and to 4:4:4 interpolate it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from nlens_video.video.pixels.samples import Axis, Plane, Samples

_FULL = Axis()


def with_full_chroma(samples: Samples) -> Samples:
    """The same picture with chroma at every pixel, linear between its samples and where they lie.

    The planes of luma and alpha are shared, and so is chroma that has every pixel.
    """
    if samples.across.step == samples.down.step == 1:
        return samples
    height, width = samples.planes[0].shape
    across, down = samples.across, samples.down
    places = np.array([  # of chroma samples, from those of pixels
        [1.0 / across.step, 0.0, -_middle_px(across) / across.step],
        [0.0, 1.0 / down.step, -_middle_px(down) / down.step],
    ])  # fmt: skip

    def full(plane: Plane) -> Plane:
        return cv2.warpAffine(
            np.ascontiguousarray(plane), places, (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip

    luma, blue, red = samples.planes
    return replace(samples, planes=(luma, full(blue), full(red)), across=_FULL, down=_FULL)


def _middle_px(axis: Axis) -> float:
    """Where the first chroma sample lies: in the middle of its filter [px]."""
    return axis.first - axis.phase + 0.5 * (len(axis.weights) - 1)
