"""The plate's shutter, from the smear of a moving camera.

Between two pictures the whole view moves by D; while the shutter is open it moves by the shutter's
share of D, and that is how long the smear is. A smear of length L leaves every edge twice in the
derivative along the motion, with opposite sign, L apart: its autocorrelation has a valley there
(Yitzhaky and Kopeika 1997).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from nlens_video.core.layers import Float32, Picture
from nlens_video.stages.f_coc import LUMA

_LEAST_MOVE_PX = 8.0
_LEAST_RESPONSE = 0.05  # of the phase correlation: less is no common motion
_LEAST_SMEAR_PX = 3.0
_LEAST_VALLEY = 0.12  # of the derivative's energy; a clear smear has near to 0.5
_PICTURES = 3
_AGREEMENT = 0.1
_LAG_STEP_PX = 0.25
_STEADY = 0.2  # share by which two pairs of pictures may disagree on the motion


def shutter_angle(pictures: Sequence[Picture]) -> float | None:
    """How long the shutter is open.

    Args:
        pictures: a shot's first ones.

    Returns:
        The angle, 360 for all of a frame's time, None where the camera does not move enough, or
        not evenly, or leaves no smear that can be measured [deg].
    """
    if len(pictures) < _PICTURES:
        return None
    first, second, third = (
        np.asarray(picture.srgb() @ LUMA, np.float32) for picture in pictures[:_PICTURES]
    )
    move, again = _common_move(first, second), _common_move(second, third)
    if move is None or again is None or math.dist(move, again) > _STEADY * math.hypot(*move):
        return None
    along = [_along_rows(luma, move) for luma in (first, second, third)]
    ways = (math.hypot(*move), math.hypot(*again))
    pairs = list(zip(along[:2], along[1:], ways, strict=True))
    # a valley that is the texture's own moves with the order of the derivative
    smear, other = (_smear_px(pairs, order) for order in (2, 3))
    if smear is None or other is None or abs(smear - other) > _AGREEMENT * smear:
        return None
    # the second picture lies in the middle of both motions
    return min(360.0, 360.0 * smear / (0.5 * sum(ways)))


def _common_move(first: Float32, second: Float32) -> tuple[float, float] | None:
    """Columns and rows by which the whole view moves [px], None where it does not."""
    if min(first.shape) < 2.0 * _LEAST_MOVE_PX:
        return None
    window = np.asarray(cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F), np.float32)
    centred = [(luma - luma.mean()) * window for luma in (first, second)]
    (across, down), response = cv2.phaseCorrelate(centred[0], centred[1])
    if math.hypot(across, down) < _LEAST_MOVE_PX or response < _LEAST_RESPONSE:
        return None
    return across, down


def _along_rows(luma: Float32, move: tuple[float, float]) -> Float32:
    """The picture turned so that the motion lies along its rows, without corners."""
    height, width = luma.shape
    turn = math.degrees(math.atan2(move[1], move[0]))
    turned = cv2.warpAffine(
        luma,
        cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), turn, 1.0),
        (width, height),
        flags=cv2.INTER_CUBIC,
    )
    angle = math.radians(turn)
    across, down = abs(math.cos(angle)), abs(math.sin(angle))
    # the largest rectangle of the same shape that lies within the turned picture
    scale = 0.98 * min(width / (width * across + height * down),
                       height / (width * down + height * across))  # fmt: skip
    rows, columns = int(height * scale), int(width * scale)
    top, left = (height - rows) // 2, (width - columns) // 2
    return np.asarray(turned[top : top + rows, left : left + columns], np.float32)


def _smear_px(pairs: Sequence[tuple[Float32, Float32, float]], order: int) -> float | None:
    """Length of an even smear along the rows [px], None where there is none.

    Pairs, since the noise of one picture is not that of the other.

    Args:
        pairs: two pictures and the way along the rows from the one to the other [px].
        order: of the derivative: pictures hang together over their width, their slopes hardly.
    """
    limit = 1.1 * min(way for _, _, way in pairs) + 2.0
    lags = np.arange(0.0, limit, _LAG_STEP_PX)
    folded = np.zeros(len(lags))
    for first, second, way in pairs:
        edges = [np.diff(luma, n=order, axis=1) for luma in (first, second)]
        size = 1 << (2 * edges[0].shape[1] - 1).bit_length()
        before, after = (np.fft.rfft(part, size, axis=1) for part in edges)
        correlation = np.roll(np.fft.irfft((np.conj(before) * after).sum(axis=0)), size // 2)
        around = np.arange(size) - size // 2
        for side in (-1, 1):
            folded += np.interp(way + side * lags, around, correlation)
    lowest = round(_LEAST_SMEAR_PX / _LAG_STEP_PX)
    if not folded[0] > 0.0 or len(folded) < lowest + 2:
        return None
    at = lowest + int(np.argmin(folded[lowest:]))
    if folded[at] > -_LEAST_VALLEY * folded[0] or at in (lowest, len(folded) - 1):
        return None
    return float(lags[at])
