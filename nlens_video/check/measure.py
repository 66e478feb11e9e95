"""The frames of plate and result measured against each other, one pair at a time."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from nlens_video.check.frame_features import FrameFeatures, block_mean
from nlens_video.check.frame_pairing import Pair, Unpaired
from nlens_video.check.regions import SECTORS, Mask, Track, Tracks
from nlens_video.core.layers import Float32, Float64

LEAST_TOLERANCE = 1.5  # what converting and rounding does to a block's mean [level]
NOISE_FACTOR = 6.0  # blocks of much texture are encoded that much worse than the middle one
_FLAT = 1.0  # detail below which only noise differs from frame to frame [level]
_LEAST_BLOCKS = 1.5  # of a sector that says something about the object's detail [block]
_STRONG = 24.0  # a block that differs by this much counts whole as the object's [level]
_DARKEST = 0.1  # what the deepest shadow leaves of a code value [1]
_TINT = 0.06  # a shadow may have the sky's hue, not the lamp's [1]
_MOST = 0.9  # of the region's blocks [1]
_CLEARER = 0.6  # another frame of the plate fits so much better than the one of this time [1]
_LEAST_GAIN = 0.3  # and by at least this [level]


@dataclass(slots=True)
class Measures:
    """What the pairs have shown so far.

    Attributes:
        tracks: the regions in which the result differs.
        dropped: indices of the plate's frames that the result lacks.
        added: indices of the result's frames that the plate does not have.
        shifted: index of each result's frame that shows another frame of the plate, and how many
            frames later that one lies.
        late: index of each result's frame shown at another time than the plate's, and by how
            much [s].
        noise: median difference of a block of each pair: what encoding has done [level].
        worst_late_s: largest shift of a frame's time [s].
        pairs: compared so far [1].
    """

    tracks: Tracks = field(default_factory=Tracks)
    dropped: array[int] = field(default_factory=lambda: array("q"))
    added: array[int] = field(default_factory=lambda: array("q"))
    shifted: list[tuple[int, int]] = field(default_factory=list)
    late: list[tuple[int, float]] = field(default_factory=list)
    noise: array[float] = field(default_factory=lambda: array("d"))
    worst_late_s: float = 0.0
    pairs: int = 0


class Measuring:
    """Takes pairs in order; keeps one frame of the result and a few numbers for each.

    Args:
        tick_s: what the two containers' clocks may round a time by [s].
    """

    def __init__(self, tick_s: float) -> None:
        self.measures = Measures()
        self._tick_s = tick_s
        self._last: FrameFeatures | None = None

    def take(self, met: Pair | Unpaired) -> None:
        """Measure the next pair, or count a frame that has no partner."""
        found = self.measures
        if isinstance(met, Unpaired):
            (found.dropped if met.dropped else found.added).append(met.index)
            return
        found.pairs += 1
        found.worst_late_s = max(found.worst_late_s, met.off_s, key=abs)
        if abs(met.off_s) > self._tick_s:
            found.late.append((met.result.index, met.off_s))
        shift = _shift(met)
        if shift:
            found.shifted.append((met.result.index, shift))
        else:
            self._differences(met)
        self._last = met.result

    def _differences(self, pair: Pair) -> None:
        difference = np.abs(pair.result.colour - pair.plate.colour).max(axis=2)
        noise = float(np.median(difference))
        self.measures.noise.append(noise)
        tolerance = LEAST_TOLERANCE + NOISE_FACTOR * noise
        seen = self.measures.tracks.follow(pair.result.index, difference, tolerance)
        anything: Mask = np.zeros(difference.shape, bool)
        for track in seen:
            anything |= track.mask
        gain = _detail_gain(pair, ~anything)
        moved = None if self._last is None else _moved(pair.result, self._last)
        for track in seen:
            _append(track, pair.result, difference, gain, moved)
            track.dimmed.append(_dimmed(pair, track.mask, tolerance))


def _append(
    track: Track, result: FrameFeatures, difference: Float32, gain: float, moved: Float32 | None
) -> None:
    weight = np.float32(track.mask) * np.clip(difference / np.float32(_STRONG), 0.0, 1.0)
    area = float(weight.sum())
    track.area.append(area)
    detail = result.detail / np.float32(gain)
    inside = float((weight * detail).sum()) / max(area, 1e-6)
    track.sharpness.append(float(np.log(_FLAT + inside)))
    track.sectors.extend(_by_sector(weight, detail))
    solid = weight >= 0.5 * weight.max()
    track.motion.append(float("nan") if moved is None else float(moved[solid].mean()))


def _dimmed(pair: Pair, mask: Mask, tolerance: float) -> bool:
    """Whether a region shows the plate itself with less light: a shadow, not a thing.

    Code values are compared, so a share of the light that is lost takes about the same share of
    luma, of the colour differences and of the detail.
    """
    plate, result = pair.plate.colour[mask], pair.result.colour[mask]
    kept = result[:, 0] / np.maximum(plate[:, 0], 1.0)
    darker = bool((result[:, 0] <= plate[:, 0] + LEAST_TOLERANCE).all() and kept.min() > _DARKEST)
    hue = np.abs(result[:, 1:] - kept[:, None] * plate[:, 1:]).max(axis=1)
    expected = kept * pair.plate.detail[mask]
    detail = np.abs(pair.result.detail[mask] - expected)
    return (
        darker
        and float(np.quantile(hue, _MOST)) <= tolerance + _TINT * (1.0 - float(kept.mean())) * 255.0
        and float(np.quantile(detail, _MOST)) <= _FLAT + 0.5 * float(expected.mean())
    )


def _by_sector(weight: Float32, detail: Float32) -> Float64:
    """Log of the detail in each sector round the middle, NaN where the object has too few blocks.

    What the lens does to the object it does to all sectors; the plate behind its outline, and the
    encoder, do something else to each.
    """
    rows, columns = np.indices(weight.shape)
    total = max(float(weight.sum()), 1e-6)
    down = rows - float((weight * rows).sum()) / total
    across = columns - float((weight * columns).sum()) / total
    turn = (np.arctan2(down, across) / (2 * np.pi)) % 1.0
    sector = np.minimum((SECTORS * turn).astype(np.int64), SECTORS - 1).ravel()
    size = np.bincount(sector, weight.ravel(), SECTORS)
    inside = np.bincount(sector, (weight * detail).ravel(), SECTORS)
    mean = inside / np.maximum(size, 1e-6)
    return np.asarray(np.where(size >= _LEAST_BLOCKS, np.log(_FLAT + mean), np.nan))


def _detail_gain(pair: Pair, plate: Mask) -> float:
    """How much of the plate's own detail encoding has kept: frames differ in that."""
    if not plate.any():
        return 1.0
    before = float(pair.plate.detail[plate].sum())
    after = float(pair.result.detail[plate].sum())
    return max(after, 1e-3) / max(before, 1e-3)


def _moved(now: FrameFeatures, before: FrameFeatures) -> Float32:
    return block_mean(np.abs(now.luma - before.luma))


def _misfit(result: FrameFeatures, plate: FrameFeatures) -> float:
    """Difference of two frames [level].

    Median over the blocks, so that an object on less than half of them does not count.
    """
    return float(np.median(np.sqrt(block_mean(np.square(result.luma - plate.luma)))))


def _shift(pair: Pair) -> int:
    """1 where the result shows the plate's next frame, -1 its last one, 0 where its own."""
    own = _misfit(pair.result, pair.plate)
    best, shift = own, 0
    for neighbour, step in ((pair.before, -1), (pair.after, 1)):
        if neighbour is None:
            continue
        off = _misfit(pair.result, neighbour)
        if off < min(best, _CLEARER * own, own - _LEAST_GAIN):
            best, shift = off, step
    return shift
