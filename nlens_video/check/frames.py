"""Frames of plate and result: their features, paired by time, and the plate's range of a result."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.check.levels import WHITE, alpha_levels, goes_above_white, levels
from nlens_video.core import signals
from nlens_video.core.color import luma as luma_weights
from nlens_video.core.layers import Float32
from nlens_video.core.settings import SourceSettings
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.input.source import open_source
from nlens_video.video.interfaces import Source
from nlens_video.video.pixels.picture import SamplesPicture
from nlens_video.video.stored_colour import SHOWN_ALIKE, UNSAID

BLOCK_PX = 8
"""Edge of a block; those of common codecs, so that their noise averages out inside one [px]."""
_BAND_PX = (1.0, 4.0)  # in finer detail, encoding noise is stronger than what the lens resolves
_CHROMA = ((2, 1 / 1.8556), (0, 1 / 1.5748))  # of B - Y and R - Y, as BT.709 scales them
_BT709 = luma_weights("bt709").astype(np.float32)
_MOST = 10.0  # limit of a block's misfit: the object is in the result alone [level]
_CLEARER = 0.97  # of the misfit of the plate's first frame: a still camera's frames differ little
_FAR_CLEARER = 0.6  # of that misfit: a frame that matches so well is not mistaken for another
_OPAQUE = 254.0  # alpha above which nothing shows through [level]
_BEYOND = 50  # frames to search after such a match


class FrameFeatures(Struct, frozen=True, eq=False):
    """Features of one frame that the check compares.

    Attributes:
        index: position in its source.
        time_s: since the source's first frame, exact [s].
        luma: display-coded, 0 to 255, more above diffuse white, (H, W) [level].
        colour: mean luma and both colour differences of each block, (h, w, 3) [level].
        detail: mean of each block's absolute band-pass of the luma, (h, w) [level].
        alpha: mean of each block, 0 to 255, (h, w); None where the picture has none [level].
    """

    index: int
    time_s: Fraction
    luma: Float32
    colour: Float32
    detail: Float32
    alpha: Float32 | None

    @property
    def rgb(self) -> tuple[Float32, Float32, Float32]:
        """Mean red, green and blue of each block, (h, w) each [level]."""
        luma = self.colour[..., 0]
        blue, red = (
            luma + self.colour[..., place] / np.float32(scale)
            for place, (_, scale) in enumerate(_CHROMA, 1)
        )
        green = (luma - _BT709[0] * red - _BT709[2] * blue) / _BT709[1]
        return red, green, blue


def frame_features(frame: SourceFrame, first_pts: int, *, above_white: bool) -> FrameFeatures:
    """Measure one frame.

    Args:
        frame: of a plate or of its result.
        first_pts: that of the source's first frame [ticks].
        above_white: whether light above diffuse white counts.

    Raises:
        TypeError: its picture has no samples.
    """
    if not isinstance(frame.picture, SamplesPicture):
        raise TypeError(f"{type(frame.picture).__name__} has no samples")
    samples = frame.picture.samples()
    rgb, alpha = levels(samples, above_white=above_white), alpha_levels(samples)
    luma: Float32 = np.ascontiguousarray(rgb @ _BT709, np.float32)
    fine, coarse = (cv2.GaussianBlur(luma, (0, 0), sigma) for sigma in _BAND_PX)
    return FrameFeatures(
        index=frame.index,
        time_s=(frame.pts - first_pts) * frame.time_base,
        luma=luma,
        colour=block_mean(
            np.dstack([luma, *(scale * (rgb[..., at] - luma) for at, scale in _CHROMA)])
        ),
        detail=block_mean(np.abs(fine - coarse)),
        alpha=None if alpha is None else block_mean(alpha),
    )


def block_mean(values: Float32) -> Float32:
    """Mean of each whole block of (H, W) or (H, W, channels); a frame below one block is one."""
    height, width = values.shape[:2]
    rows, columns = max(1, height // BLOCK_PX), max(1, width // BLOCK_PX)
    whole = values[: min(height, rows * BLOCK_PX), : min(width, columns * BLOCK_PX)]
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)


def block_rms(first: FrameFeatures, second: FrameFeatures) -> Float32:
    """Root mean square difference in luma of each block, (h, w) [level]."""
    return np.asarray(np.sqrt(block_mean(np.square(first.luma - second.luma))), np.float32)


class Pair(Struct, frozen=True, eq=False):
    """A frame of the result and the plate's frame of that time.

    Attributes:
        plate: the plate's frame.
        result: the result's frame.
        before: the plate's frame before, None at its beginning.
        after: the plate's frame after, None at its end.
    """

    plate: FrameFeatures
    result: FrameFeatures
    before: FrameFeatures | None
    after: FrameFeatures | None

    @property
    def delay_s(self) -> float:
        """How much later the result's frame is shown [s]."""
        return float(self.result.time_s - self.plate.time_s)

    @property
    def alpha_change(self) -> Float32:
        """By how much alpha of each block is larger in the result, (h, w) [level].

        0 where the result has lost it, which is a fault of its own (`loses_alpha`).
        """
        if self.result.alpha is None:
            return np.zeros_like(self.plate.detail)
        before = WHITE if self.plate.alpha is None else self.plate.alpha
        return np.asarray(self.result.alpha - before, np.float32)

    @property
    def loses_alpha(self) -> bool:
        """Whether the plate is transparent somewhere, and the result has no alpha."""
        alpha = self.plate.alpha
        return self.result.alpha is None and alpha is not None and bool((alpha < _OPAQUE).any())


class Unpaired(Struct, frozen=True):
    """A frame without a partner: the plate's (`dropped`), or one that the result has added."""

    index: int
    dropped: bool


def pair_frames(
    plate: Iterator[FrameFeatures], result: Iterator[FrameFeatures]
) -> Iterator[Pair | Unpaired]:
    """Pair frames whose times differ by less than half a plate's frame; holds four at a time."""
    before: FrameFeatures | None = None
    now, after = next(plate, None), next(plate, None)
    shown = next(result, None)
    step = Fraction(1, 25)
    while now is not None and shown is not None:
        step = after.time_s - now.time_s if after is not None else step
        if abs(shown.time_s - now.time_s) <= step / 2:
            yield Pair(now, shown, before, after)
            shown = next(result, None)
        elif shown.time_s < now.time_s:
            yield Unpaired(shown.index, dropped=False)
            shown = next(result, None)
            continue
        else:
            yield Unpaired(now.index, dropped=True)
        before, now, after = now, after, next(plate, None)
    while now is not None:
        yield Unpaired(now.index, dropped=True)
        now, after = after, next(plate, None)
    while shown is not None:
        yield Unpaired(shown.index, dropped=False)
        shown = next(result, None)


def open_result(spec: str, plate: SourceInfo, transfer: str | None) -> Source:
    """Open a result, and read its first frame.

    Args:
        spec: written by `render`, which keeps the plate's codes. Where it tells no transfer
            function, as pictures do, it has the plate's, if players show that like the usual one.
        plate: properties of its plate.
        transfer: name of a transfer function that overrides the plate's tag, as it then does that
            of a result that has the same one.

    Raises:
        InputError: it cannot be read.
    """
    made = open_source(spec)
    tag = made.info.frame_tags.color_trc
    if transfer is not None and tag == plate.frame_tags.color_trc:
        curve = transfer
    elif tag in UNSAID and plate.tags.transfer in SHOWN_ALIKE:
        curve = plate.tags.transfer
    else:
        return made
    known = made.info.codec == "exr" or made.info.tags.transfer == curve
    if known or not can_be_read_again(spec):
        return made
    made.close()
    return open_source(spec, input_transfer=curve)


def find_range(result: str, plate: SourceSettings) -> tuple[int, int] | None:
    """Range of the plate that a shorter result shows, found by the result's first frame.

    A result that begins with its plate, and lacks only some of its end, has lost frames rather than
    been cut.

    Args:
        result: written by `render`, possibly with `--range`.
        plate: its plate, whose range is not used.

    Returns:
        First index and the one past the last; None where the result has as many frames as its
        plate, or begins with it and has more than half of them, or where one of the two cannot be
        read twice.

    Raises:
        InputError: one of the two cannot be read.
    """
    if not (can_be_read_again(result) and can_be_read_again(plate.spec)):
        return None
    with (
        open_source(plate.spec, **plate.hints) as given,
        open_result(result, given.info, plate.input_transfer) as made,
    ):
        frames, plate_frames = made.info.frame_count, given.info.frame_count
        whole = frames is not None and plate_frames is not None and frames >= plate_frames
        sizes = {(one.info.width, one.info.height) for one in (made, given)}
        if whole or len(sizes) > 1:
            return None
        rest = iter(made)
        frame = next(rest, None)
        first = 0 if frame is None else _best_match(frame, given)
        end = first + sum(1 for _ in rest) + (frame is not None)
        begins = not first and plate_frames is not None and 0 < end <= plate_frames // 2
        return (first, end) if first or begins else None


def _best_match(beginning: SourceFrame, plate: Source) -> int:
    """Index of the plate's frame that differs least; 0 unless it is clearly better than that."""
    above_white = goes_above_white(plate.info.tags)
    sought = frame_features(beginning, beginning.pts, above_white=above_white)
    best, least, own = 0, 0.0, 0.0
    for frame in plate:
        signals.check()
        # mean of the blocks, since a median would miss the little that moves
        shown = frame_features(frame, frame.pts, above_white=above_white)
        misfit = np.minimum(block_rms(sought, shown), _MOST)
        off = float(misfit.mean())
        if frame.index == 0:
            own = least = off
        if off < least:
            best, least = frame.index, off
        if least < _FAR_CLEARER * own and frame.index >= best + _BEYOND:
            break
    return best if least < _CLEARER * own else 0
