"""F: the plate's circle of confusion from one picture (paper, section 4.1).

The network knows CoC from 0 to 64 px on pictures about 960 px wide. A larger frame is reduced (area
average) until its longer side is `WORKING_SIDE_PX`, a smaller one enlarged up to twice (Lanczos),
and the diameters are scaled back. The network cannot tell a CoC below about 1.5 px of what it sees
from the softness of lens and sensor; on a frame of half the size that is 0.8 px of its own.

Noise hides a small or smooth blur. While the camera stands still, the network reads the mean of
several frames; pixels that move keep the first frame's samples, since a mean over motion looks like
defocus.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Protocol

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, CocMap, Float32, Picture
from nlens_video.stages.whole_ground.patches import reading_cells

WORKING_SIDE_PX = 960
LARGEST_COC_PX = 64.0  # of the network's training [px of the working size]
LARGEST_ENLARGEMENT = 2.0  # beyond it the network reads the softness of the interpolation
FLAT = 0.6 / 255  # contrast below which a picture holds nothing but its own rounding [sRGB code]
STILL_PX = 0.25  # a mean over a larger shift softens the picture measurably
QUIET = 1.2 / 255  # noise below which averaging gains nothing [sRGB code]
LUMA = np.array([0.3, 0.6, 0.1], np.float32)
"""Weights of red, green and blue in the brightness of display codes."""
_FLAT_WINDOW_PX = 33
_CLEAR_PEAK = 0.3  # of phase correlation, below which noise may have displaced it
_LEAST_CURVATURE = 0.2  # of the squared difference, as a share of its least, for a clear minimum
_MOTION_WINDOW_PX = 7  # noise averages out over it, motion does not
_NOISES = 5.0  # a change of the window's mean beyond so many deviations is motion
_LEAST_CHANGE = 1.5 / 255  # smallest change that counts as motion [sRGB code]


class CocNetwork(Protocol):
    """A network that estimates the CoC of a picture."""

    @property
    def stride(self) -> int:
        """Height and width of its input must be multiples of this [px]."""
        ...

    def __call__(self, rgb: Float32) -> CocMap:
        """Estimate one picture.

        Args:
            rgb: display-coded sRGB in [0, 1] (H, W, 3), H and W multiples of `stride`.

        Returns:
            Maps (h, w) that cover the same picture, perhaps coarser; diameters in px of the input.
        """
        ...


class EstimateCoc(Struct, frozen=True):
    """F as a stage. Keeps nothing between pictures.

    Attributes:
        network: estimates the CoC.
        pixel_aspect: width of a pixel by its height [1].
    """

    network: CocNetwork
    pixel_aspect: float = 1.0

    def __call__(self, picture: Picture, following: Sequence[Picture] = ()) -> CocMap:
        """Unsigned CoC and its expected error of a whole picture, at its full size.

        Args:
            picture: the plate.
            following: later frames of the same size, averaged with it as far as the camera stands
                still.
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
        network: estimates the CoC.
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


def _read(network: CocNetwork, working: Float32, size: tuple[int, int]) -> CocMap:
    """The maps of a picture of working size, at (W, H) `size` and in its columns."""
    below, right = (-n % network.stride for n in working.shape[:2])
    # a mirrored border continues the texture at its own sharpness; a repeated one would smear it
    padded = np.pad(working, ((0, below), (0, right), (0, 0)), mode="symmetric")
    coarse = network(padded)
    scale = size[0] / working.shape[1]
    coc, sigma = (
        np.float32(scale) * _enlarged(values, padded, working, size)
        for values in (coarse.coc_px, coarse.sigma_px)
    )
    flat = cv2.resize(_flat(working), size, interpolation=cv2.INTER_LINEAR) > 0.5
    sigma[flat] = np.maximum(sigma[flat], np.float32(scale * LARGEST_COC_PX))
    prior = None if coarse.prior is None else replace(coarse.prior, scale=scale)
    luma = np.asarray(working @ LUMA, dtype=np.float32)
    return CocMap(
        coc_px=coc,
        sigma_px=sigma,
        prior=prior,
        luma=luma,
        cells=reading_cells(coarse, padded.shape[1]),
    )


def _flat(rgb: Float32) -> Float32:
    """1 where a picture has no contrast to read a blur from, such as a clipped sky; else 0."""
    luma = rgb @ LUMA
    window = (_FLAT_WINDOW_PX, _FLAT_WINDOW_PX)
    mean = cv2.boxFilter(luma, -1, window, borderType=cv2.BORDER_REFLECT)
    spread = cv2.boxFilter((luma - mean) ** 2, -1, window, borderType=cv2.BORDER_REFLECT)
    return np.asarray(spread < FLAT**2, dtype=np.float32)


def _enlarged(values: Float32, padded: Float32, working: Float32, size: tuple[int, int]) -> Float32:
    """A map over the padded picture, at (W, H) `size`, without the padding."""
    full = cv2.resize(values, padded.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    kept = full[: working.shape[0], : working.shape[1]]
    if kept.shape != size[::-1]:
        kept = cv2.resize(kept, size, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(kept, dtype=np.float32).reshape(size[::-1])


def temporal_mean(first: Float32, following: Iterable[Float32]) -> tuple[Float32, int]:
    """The mean of a picture and the later ones that show the same.

    Args:
        first: display-coded sRGB in [0, 1] (H, W, 3).
        following: later pictures of the same size, in order; none is read after the camera moved,
            nor after the first where that shows hardly any noise.

    Returns:
        The mean (H, W, 3), and the number of pictures in it.
    """
    luma = np.asarray(first @ LUMA, dtype=np.float32)
    window = _border_window(luma)
    total, count = first.astype(np.float32), np.ones(luma.shape, np.float32)
    used = 1
    for picture in following:
        other = np.asarray(picture @ LUMA, dtype=np.float32)
        if (used == 1 and _noise(luma, other) < QUIET) or not _is_still(luma, other, window):
            break
        same = (~_moving(luma, other)).astype(np.uint8)
        cv2.accumulate(picture, total, mask=same)
        count += same
        used += 1
    return total / count[..., None], used


def still_run(pictures: Sequence[Float32]) -> tuple[list[Float32], Bool]:
    """The pictures at the beginning of a shot during which the camera stands still.

    Args:
        pictures: display-coded sRGB in [0, 1], each (H, W, 3), at least one.

    Returns:
        The pictures, and the pixels (H, W) on which nothing moves in any of them.
    """
    first = np.asarray(pictures[0] @ LUMA, np.float32)
    window = _border_window(first)
    kept, same = [pictures[0]], np.ones(first.shape, np.bool_)
    for picture in pictures[1:]:
        luma = np.asarray(picture @ LUMA, np.float32)
        if not _is_still(first, luma, window):
            break
        same &= ~_moving(first, luma)
        kept.append(picture)
    return kept, same


def _noise(luma: Float32, other: Float32) -> float:
    """Deviation of the noise in each of two pictures of the same scene [sRGB code]."""
    return 1.4826 * float(np.median(np.abs(other - luma)[::2, ::2])) / math.sqrt(2.0)


def _border_window(luma: Float32) -> Float32:
    """Weights (H, W) that fade out towards the borders; 1 for a single row or column."""
    if min(luma.shape) < 2:
        return np.ones_like(luma)
    return np.asarray(cv2.createHanningWindow(luma.shape[::-1], cv2.CV_32F), np.float32)


def _is_still(luma: Float32, other: Float32, window: Float32) -> bool:
    """Whether the camera stands still between two pictures (H, W).

    By phase correlation; coarse noise hides its peak, and then by where the two differ least.
    """
    if min(luma.shape) < 2 * _MOTION_WINDOW_PX:
        return False
    # with a window of its own phaseCorrelate writes into both pictures
    (across, down), peak = cv2.phaseCorrelate(luma * window, other * window)
    if peak >= _CLEAR_PEAK or math.hypot(across, down) <= STILL_PX:
        return math.hypot(across, down) <= STILL_PX
    return math.hypot(*(_shift(luma, other, axis) for axis in (0, 1))) <= 0.5 * STILL_PX


def _shift(luma: Float32, other: Float32, axis: int) -> float:
    """Shift along an axis at which two pictures (H, W) differ least, infinite if unclear [px].

    The vertex of a parabola through the squared differences at -1, 0 and 1 px, to which noise adds
    the same in the mean. At hard edges it tells half of a small shift.
    """
    one, two = (np.moveaxis(picture, axis, 0) for picture in (luma, other))
    before, here, after = (
        float(np.square(two[1:-1] - one[1 + away : len(one) - 1 + away]).mean())
        for away in (-1, 0, 1)
    )
    curvature = before - 2.0 * here + after
    if curvature <= _LEAST_CURVATURE * here:
        return math.inf
    return (before - after) / (2.0 * curvature)


def _moving(luma: Float32, other: Float32) -> Bool:
    """Pixels (H, W) where something moves between two pictures, their surroundings included."""
    side = _MOTION_WINDOW_PX
    change = cv2.blur(other - luma, (side, side), borderType=cv2.BORDER_REFLECT)
    some = change[::3, ::3]
    whole = np.median(some)  # a change of the light as a whole is no motion
    noise = 1.4826 * float(np.median(np.abs(some - whole)))
    moved = np.abs(change - whole) > max(_NOISES * noise, _LEAST_CHANGE)
    around = np.ones((2 * side + 1, 2 * side + 1), np.uint8)
    return np.asarray(cv2.dilate(moved.astype(np.uint8), around) > 0)
