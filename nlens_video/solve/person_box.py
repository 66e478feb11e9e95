"""The box of a person from one point on the body: OpenCV's detector of pedestrians, without files.

Windows of histograms of gradients (Dalal and Triggs 2005) are tried at many sizes; those around the
point vote for head and feet by their scores.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import InputError

_WINDOW = 128  # rows of the detector's window [px]
_MARGIN = 16 / 128  # above the head and below the feet, by the window's rows [1]
_LARGEST = 720  # rows of the picture that is searched [px]
_FINER = 1.04  # between sizes that are tried [1]
_STRIDE = 8  # [px]
_LEAST = 0.3  # score of a window
_WITHIN = 0.25, 0.45  # of the point from a window's middle, by its columns and rows [1]


def find_person(
    luma: npt.NDArray[np.uint8], at: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Left, upper, right and lower border of the upright person around a point [frame].

    Head and feet are found to about a tenth of the height.

    Args:
        luma: picture (H, W).
        at: column and row of a point on the body [frame].

    Raises:
        InputError: no person is found there.
    """
    height, width = luma.shape
    scale = _LARGEST / height
    half = min(1.0, 0.5 * height / width)  # a window is half as wide as high
    left = max(0, round((at[0] - half) * width))
    part = luma[:, left : round(min(1.0, at[0] + half) * width)]
    size = max(1, round(scale * part.shape[1])), _LARGEST
    edge = _WINDOW // 2  # so that a window reaches beyond the frame
    enlarged = cv2.resize(part, size, interpolation=cv2.INTER_LINEAR)
    searched = cv2.copyMakeBorder(enlarged, edge, edge, edge, edge, cv2.BORDER_REPLICATE)
    detector = cv2.HOGDescriptor()
    detector.setSVMDetector(np.array(cv2.HOGDescriptor.getDefaultPeopleDetector(), np.float32))
    windows, scores = detector.detectMultiScale(
        searched, hitThreshold=_LEAST, winStride=(_STRIDE, _STRIDE), scale=_FINER, groupThreshold=0
    )
    found = np.asarray(windows, np.float64).reshape(-1, 4)
    found[:, :2] -= edge
    found /= scale
    found[:, 0] += left
    middle = found[:, :2] + 0.5 * found[:, 2:]
    off = abs(middle - np.array(at) * (width, height)) / found[:, 2:]
    near = (off < _WITHIN).all(axis=1)
    if not near.any():
        raise InputError(
            f"--person: no upright person is found around {at[0]:g},{at[1]:g} of the first frame; "
            "give the box X0,Y0,X1,Y1 from head to feet"
        )
    votes = np.asarray(scores, np.float64).reshape(-1)[near]
    x, y, columns, rows = votes @ found[near] / votes.sum()
    box = np.array([x, y + _MARGIN * rows, x + columns, y + (1.0 - _MARGIN) * rows])
    box = np.clip(box / [width, height, width, height], 0.0, 1.0)
    return float(box[0]), float(box[1]), float(box[2]), float(box[3])
