"""F: the plate's circle of confusion from one picture (paper, section 4.1).

The network knows CoC from 0 to 64 px on pictures about 960 px wide. A larger frame is reduced (area
average) until its longer side is `WORKING_SIDE_PX`, a smaller one enlarged up to twice (Lanczos),
and the diameters are scaled back. The network cannot tell a CoC below about 1.5 px of what it sees
from the softness of lens and sensor; on a frame of half the size that is 0.8 px of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nlens_video.core.layers import CocMap, Float32, Picture
from nlens_video.stages.f_temporal_mean import temporal_mean
from nlens_video.stages.protocols import CocNetwork

WORKING_SIDE_PX = 960
LARGEST_COC_PX = 64.0  # what the network was trained to see [px of the working size]
LARGEST_ENLARGEMENT = 2.0  # beyond it the interpolation's own softness is what is read
FLAT = 0.6 / 255  # contrast below which a picture holds nothing but its own rounding [sRGB code]
_FLAT_WINDOW_PX = 33


@dataclass(frozen=True, slots=True)
class EstimateCoc:
    """F as a stage. Keeps nothing between pictures.

    Attributes:
        network: reads the blur off a picture.
        pixel_aspect: width of a pixel by its height [1].
    """

    network: CocNetwork
    pixel_aspect: float = 1.0

    def __call__(self, picture: Picture, following: Sequence[Picture] = ()) -> CocMap:
        """Unsigned CoC and its expected error of a whole picture, at its full size.

        Args:
            picture: the plate.
            following: later frames of the same size; those that a still camera saw are averaged
                with it against noise (`f_temporal_mean`).
        """
        working, used = to_working_size(picture.srgb(), self.pixel_aspect), 1
        if following:
            later = (to_working_size(frame.srgb(), self.pixel_aspect) for frame in following)
            working, used = temporal_mean(working, later)
        coc = _read(self.network, working, (picture.width, picture.height))
        return replace(coc, frames=used)


def estimate_coc(network: CocNetwork, rgb: Float32, pixel_aspect: float = 1.0) -> CocMap:
    """Unsigned CoC and its expected error of a picture of any size.

    Args:
        network: reads the blur off a picture.
        rgb: display-coded sRGB in [0, 1] (H, W, 3).
        pixel_aspect: width of a pixel by its height; the network sees square pixels [1].

    Returns:
        Maps (H, W) [columns of this picture].

    Raises:
        ValueError: not a picture (H, W, 3) with at least one pixel.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.size == 0:
        raise ValueError(f"{rgb.shape = } must be (H, W, 3) with at least one pixel")
    working = to_working_size(np.asarray(rgb, dtype=np.float32), pixel_aspect)
    return _read(network, working, (rgb.shape[1], rgb.shape[0]))


def _read(network: CocNetwork, working: Float32, size: tuple[int, int]) -> CocMap:
    """The maps of a picture of working size, at (W, H) `size` and in its columns."""
    width, height = size
    below, right = (-n % network.stride for n in working.shape[:2])
    # a mirrored border continues the texture at its own sharpness; a repeated one would smear it
    padded = np.pad(working, ((0, below), (0, right), (0, 0)), mode="symmetric")
    coarse = network(padded)
    scale = width / working.shape[1]
    coc, sigma = (
        np.float32(scale) * _enlarged(values, padded, working, (width, height))
        for values in (coarse.coc_px, coarse.sigma_px)
    )
    flat = cv2.resize(_flat(working), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
    sigma[flat] = np.maximum(sigma[flat], np.float32(scale * LARGEST_COC_PX))
    prior = None if coarse.prior is None else replace(coarse.prior, scale=scale)
    return CocMap(coc_px=coc, sigma_px=sigma, prior=prior)


def _flat(rgb: Float32) -> Float32:
    """1 where a picture has no contrast to read a blur from, such as a clipped sky; else 0."""
    luma = rgb @ np.array([0.3, 0.6, 0.1], np.float32)
    window = (_FLAT_WINDOW_PX, _FLAT_WINDOW_PX)
    mean = cv2.boxFilter(luma, -1, window, borderType=cv2.BORDER_REFLECT)
    spread = cv2.boxFilter((luma - mean) ** 2, -1, window, borderType=cv2.BORDER_REFLECT)
    return np.asarray(spread < FLAT**2, dtype=np.float32)


def to_working_size(rgb: Float32, pixel_aspect: float) -> Float32:
    """The picture in square pixels, its longer side `WORKING_SIDE_PX` as far as that is of use."""
    height, width = rgb.shape[:2]
    # the side with the finer pixels is reduced, rather than the other one enlarged
    wide, high = width * min(1.0, pixel_aspect), height * min(1.0, 1.0 / pixel_aspect)
    ratio = min(LARGEST_ENLARGEMENT, WORKING_SIDE_PX / max(wide, high))
    size = (max(1, round(wide * ratio)), max(1, round(high * ratio)))
    if size == (width, height):
        return rgb
    if ratio <= 1:
        return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    enlarged = cv2.resize(rgb, size, interpolation=cv2.INTER_LANCZOS4)
    return np.asarray(np.clip(enlarged, 0, 1), dtype=np.float32)


def _enlarged(values: Float32, padded: Float32, working: Float32, size: tuple[int, int]) -> Float32:
    """A map over the padded picture, brought to its size, without the padding, at (W, H) `size`."""
    full = cv2.resize(values, padded.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    kept = full[: working.shape[0], : working.shape[1]]
    if kept.shape != size[::-1]:
        kept = cv2.resize(kept, size, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(kept, dtype=np.float32).reshape(size[::-1])
