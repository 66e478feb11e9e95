"""A bounded, evenly spaced sample of a shot's frames, and their median at each pixel.

Frames are given as the square root of their light, in which noise is about as strong in dark
pixels as in bright ones. A pixel that a frame does not show is NaN.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32
from nlens_video.kernels.channels import channel_max

MIN_CHANGE = 14.0 / 255.0
"""Least change of the square root of light that counts as motion [1]."""
MAX_FRAMES, MAX_FRAMES_LARGE, LARGE_REGION_PX = 21, 11, 3_000_000
"""Most frames in a sample, the same for large regions, and how large those are [1, 1, px]."""
MIN_FRAMES = 3
"""Least number of frames from which a background is estimated."""
CODE_SCALE = 16383.0
"""Code of a square root of light of 1; roots up to 4 stay below `UNKNOWN_CODE`."""
UNKNOWN_CODE = np.uint16(65535)
"""Code of a pixel that a frame does not show."""
_MIN_NOISE = 0.8 / 255.0  # least standard deviation of a square root of light [1]

Codes = npt.NDArray[np.uint16]
"""A frame's square roots of light, times `CODE_SCALE`."""


def upper_median(frames: Sequence[Codes]) -> Codes:
    """Median of frames at each value; of an even number of frames the upper one of the middle two.

    Selection by minima and maxima of whole arrays: `np.partition` along the frames is slow. Of any
    n / 2 + 2 values the least and the greatest cannot be the median of n. Both are dropped, and the
    next frame is taken in.
    """
    waiting = [one.copy() for one in frames]
    if len(waiting) % 2 == 0:
        waiting.append(np.full_like(waiting[0], np.iinfo(waiting[0].dtype).max))
    spare = np.empty_like(waiting[0])
    held = [waiting.pop() for _ in range(min(len(waiting), len(waiting) // 2 + 2))]
    while True:
        for i in range(1, len(held)):  # moves the minimum to the front
            np.minimum(held[0], held[i], out=spare)
            np.maximum(held[0], held[i], out=held[i])
            held[0], spare = spare, held[0]
        if not waiting and len(held) == 1:
            return held[0]
        for i in range(1, len(held) - 1):  # moves the maximum to the end
            np.maximum(held[-1], held[i], out=spare)
            np.minimum(held[-1], held[i], out=held[i])
            held[-1], spare = spare, held[-1]
        held = held[1:-1]
        if waiting:
            held.append(waiting.pop())


@dataclass(slots=True)
class FrameSampler:
    """Keeps at most `max_frames` frames, evenly spaced over all that were added."""

    max_frames: int = MAX_FRAMES
    _stride: int = 1
    _added: int = 0
    _frames: list[Codes] = field(default_factory=list)
    _has_unknown: bool = False

    @property
    def takes_next(self) -> bool:
        """Whether the next frame will be kept."""
        return self._added % self._stride == 0

    @property
    def frames(self) -> Sequence[Codes]:
        """The frames that are kept (h, w, 3), `UNKNOWN_CODE` where they show nothing."""
        return self._frames

    def add(self, roots: Float32 | None) -> None:
        """Add the next frame.

        Args:
            roots: square root of its light (h, w, 3), NaN where it shows nothing; None for a frame
                that is not kept, see `takes_next`.
        """
        if self.takes_next and roots is not None:
            unknown = np.isnan(roots[..., 0])
            has_unknown = bool(unknown.any())
            known = np.nan_to_num(roots) if has_unknown else roots
            codes = (np.clip(known, 0.0, 4.0) * np.float32(CODE_SCALE)).astype(np.uint16)
            if has_unknown:
                codes[unknown] = UNKNOWN_CODE
                self._has_unknown = True
            self._frames.append(codes)
        self._added += 1
        if len(self._frames) > self.max_frames:
            del self._frames[1::2]
            self._stride *= 2

    def median(self) -> tuple[Float32, Float32]:
        """Median of the frames (h, w, 3), and the noise of a frame (h, w) [1].

        The noise is the median absolute deviation, smoothed. It is clipped to one to three times
        its own median over the pixels, for it is larger where the background itself is uncertain.
        Where no frame shows anything, the median is 0 and the noise is at its minimum.
        """
        shown = self.valid_counts > 0
        codes = upper_median(self._fill_unknown(self._frames))
        codes[~shown] = 0
        deviations = self._fill_unknown([self._deviation(one, codes) for one in self._frames])
        noise = upper_median(deviations).astype(np.float32) / np.float32(CODE_SCALE)
        noise[~shown] = 0.0
        smooth = cv2.blur(noise, (5, 5))
        floor = max(_MIN_NOISE, float(np.median(smooth[shown])) if shown.any() else 0.0)
        noise = np.clip(smooth, np.float32(floor), np.float32(3.0 * floor))
        return codes.astype(np.float32) / np.float32(CODE_SCALE), noise

    @property
    def valid_counts(self) -> npt.NDArray[np.int32]:
        """Number of the frames that show each pixel (h, w)."""
        counts = np.zeros(self._frames[0].shape[:2], np.int32)
        for one in self._frames:
            counts += one[..., 0] != UNKNOWN_CODE
        return counts

    def deviations(self, background: Float32) -> Iterator[Float32]:
        """Absolute deviation of each frame from a background (h, w) [1]; NaN beyond the frame."""
        for codes in self._frames:
            roots = codes.astype(np.float32) / np.float32(CODE_SCALE)
            deviation = channel_max(np.abs(roots - background))
            if self._has_unknown:
                deviation[codes[..., 0] == UNKNOWN_CODE] = np.nan
            yield deviation

    def agreement(self, background: Float32, noise: Float32) -> Float32:
        """Fraction (h, w) of the frames showing a pixel that show the background there [1].

        0 where fewer than `MIN_FRAMES` show the pixel.
        """
        limit = np.maximum(np.float32(MIN_CHANGE), 4.0 * noise)
        agreeing = np.zeros(background.shape[:2], np.float32)
        for deviation in self.deviations(background):
            agreeing += deviation < limit
        counts = self.valid_counts
        agreeing /= np.maximum(counts, 1).astype(np.float32)
        return np.where(counts < MIN_FRAMES, np.float32(0.0), agreeing)

    def _deviation(self, frame: Codes, median: Codes) -> Codes:
        deviation = channel_max(np.maximum(frame, median) - np.minimum(frame, median))
        if self._has_unknown:
            deviation[frame[..., 0] == UNKNOWN_CODE] = UNKNOWN_CODE
        return np.asarray(deviation, np.uint16)

    def _fill_unknown(self, frames: list[Codes]) -> list[Codes]:
        """Frames in which unknown pixels are the smallest and the greatest code by turns.

        The median of all frames is then the median of those that show the pixel.
        """
        if not self._has_unknown:
            return frames
        low = np.ones(frames[0].shape[:2], np.bool_)
        filled = []
        for one in frames:
            unknown = (one if one.ndim == 2 else one[..., 0]) == UNKNOWN_CODE
            codes = one.copy()
            codes[unknown & low] = 0
            low ^= unknown
            filled.append(codes)
        return filled
