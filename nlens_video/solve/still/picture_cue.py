"""What a picture of ground, things and walls looks like at a pitch: a learned cue.

A network (`models/camera`) sees on a coarse grid which way the picture's edges run, how strong
they are at three scales, and its colours. It answers with a distribution of pitch, roll and focal
length. It tells them coarsely, where lines tell them finely or not at all, and it does not share
the errors of lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64

CameraNetwork = Callable[[Float32, Float32], Float32]
"""Features (ROWS, COLUMNS, CHANNELS) and logarithm of the aspect (1,) to ANSWERS numbers."""
ROWS, COLUMNS = 8, 14
BINS, SCALES = 16, 3
CHANNELS = SCALES * (BINS + 1) + 3
ANSWERS = 9
"""Three means, and a lower triangle: logarithms of its diagonal, then the entries (1, 0), (2, 0)
and (2, 1)."""
AREA_PX = 240 * 128
"""Pixels that a picture is reduced to, whatever its aspect."""
_FINER_PX = 384 * 216  # edges are taken off the reduced picture drawn this large
MIDDLES, SPREADS = np.array([-0.3, 0.0, 0.2]), np.array([0.3, 0.07, 0.45])
"""Of pitch, roll [rad] and of the logarithm of the focal length by the root of the area: what the
network answers in."""
FREEDOM = 5.0
"""Degrees of freedom of the multivariate t distribution that it tells."""
LOGARITHMS = (-3.0, 4.0)
"""Limits of the logarithms of the triangle's diagonal."""
_WIDER = 2.0  # stated errors by those that the network tells, on rendered plates [1]
_OUTLIER, _OUTLIER_DENSITY = 0.15, 12.0  # share; as dense as at so many squared errors by FREEDOM
_FAINT, _EVEN, _DARK = 0.01, 0.004, 0.002  # gradients [code value by px]

_TURNED_BACK = np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0, -1.0])  # roll's sign
_MIRRORED = np.array([
    scale * (BINS + 1) + (-bin_) % BINS if bin_ < BINS else scale * (BINS + 1) + BINS
    for scale in range(SCALES) for bin_ in range(BINS + 1)
] + [SCALES * (BINS + 1) + colour for colour in range(3)])  # fmt: skip


class PictureCue(Struct, frozen=True):
    """What a picture looks like it was taken by.

    Attributes:
        middle: pitch, roll [rad] and log focal length by the frame's width (3,).
        root: of their information, lower triangular (3, 3).
    """

    middle: Float64
    root: Float64

    def log(self, cameras: Float64) -> Float64:
        """Logarithm of its likelihood (…,), up to a constant; it may be an outlier.

        Args:
            cameras: pitch, roll [rad] and log focal length by the frame's width (…, 3).
        """
        off = ((cameras - self.middle) @ self.root.T) ** 2
        power = -0.5 * (FREEDOM + 3.0)
        near = (1.0 + off.sum(axis=-1) / FREEDOM) ** power
        outlier = _OUTLIER * (1.0 + _OUTLIER_DENSITY) ** power
        return np.asarray(np.log((1.0 - _OUTLIER) * near + outlier))

    @property
    def errors(self) -> Float64:
        """Standard errors of the three (3,)."""
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(self.root.T @ self.root))))


def picture_cue(network: CameraNetwork, rgb: Float32) -> PictureCue:
    """Read a picture and its mirror image, whose roll is the opposite.

    Args:
        network: the camera network.
        rgb: picture (H, W, 3), sRGB in [0, 1], with square pixels.
    """
    height, width = rgb.shape[:2]
    aspect = math.log(width / height)
    code = np.clip(255.0 * reduced(rgb) + 0.5, 0.0, 255.0).astype(np.uint8)
    features, log_aspect = picture_features(code), np.array([aspect], np.float32)
    answer = 0.5 * network(features, log_aspect).astype(np.float64)
    answer += 0.5 * _TURNED_BACK * network(mirrored(features), log_aspect)
    middle = MIDDLES + SPREADS * answer[:3]
    middle[2] -= 0.5 * aspect  # from the root of the area to the width
    root = np.diag(np.exp(np.clip(answer[3:6], *LOGARITHMS)))
    root[1, 0], root[2, 0], root[2, 1] = answer[6:]
    return PictureCue(middle, root / SPREADS / _WIDER)


def reduced(rgb: Float32) -> Float32:
    """A picture (H, W, 3) at about AREA_PX pixels."""
    size = size_of_area(AREA_PX, rgb.shape[1] / rgb.shape[0])
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA))


def size_of_area(area_px: float, aspect: float) -> tuple[int, int]:
    """Columns and rows of so many pixels at a width by height."""
    return round(math.sqrt(area_px * aspect)), round(math.sqrt(area_px / aspect))


def picture_features(rgb: npt.NDArray[np.uint8]) -> Float32:
    """Where edges run, how strong they are, and colours (ROWS, COLUMNS, CHANNELS).

    For each of three scales a histogram of the directions of gradients and the logarithm of their
    strength; then the mean code values.

    Args:
        rgb: a picture of about AREA_PX pixels (H, W, 3), sRGB.
    """
    size = size_of_area(_FINER_PX, rgb.shape[1] / rgb.shape[0])
    fine = cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR)
    grey = cv2.cvtColor(fine, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255.0
    found = []
    for _ in range(SCALES):
        found += _directions(grey)
        grey = np.asarray(cv2.pyrDown(grey), np.float32)
    colour = cv2.resize(rgb, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    return np.concatenate([*found, np.float32(colour) / 255.0], axis=-1, dtype=np.float32)


def mirrored(features: Float32) -> Float32:
    """The features (…, ROWS, COLUMNS, CHANNELS) of the picture mirrored left to right."""
    return np.asarray(features[..., ::-1, _MIRRORED])


def _directions(grey: Float32) -> list[Float64]:
    """Shares of directions of gradients (ROWS, COLUMNS, BINS), logarithm of their sum (…, 1)."""
    across, down = (
        np.asarray(cv2.Scharr(grey, cv2.CV_32F, *axis), np.float32) / np.float32(32.0)
        for axis in ((1, 0), (0, 1))
    )
    # not by OpenCV, whose last bit goes by the arrays' places in memory
    length = np.sqrt(across * across + down * down)
    strength = np.maximum(length - _FAINT, 0.0)
    turn = cv2.phase(across, down) % np.pi / np.pi * BINS
    low = np.floor(turn)
    part, first = turn - low, low.astype(np.intp) % BINS
    rows, columns = grey.shape
    cell_y, cell_x = np.arange(rows) * ROWS // rows, np.arange(columns) * COLUMNS // columns
    place = (cell_y[:, None] * COLUMNS + cell_x) * BINS
    sums = np.zeros(ROWS * COLUMNS * BINS)
    for place_of, share in ((first, 1.0 - part), ((first + 1) % BINS, part)):
        sums += np.bincount((place + place_of).ravel(), (strength * share).ravel(), len(sums))
    sums = sums.reshape(ROWS, COLUMNS, BINS) * (ROWS * COLUMNS / grey.size)
    total = sums.sum(axis=-1, keepdims=True)
    return [sums / (total + _EVEN), np.log(total + _DARK)]
