"""Measures of a result against its plate, frame by frame.

Memory grows by a few numbers a frame.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.check.drift import DriftMeasure
from nlens_video.check.frames import FrameFeatures, Pair, Unpaired, block_mean, block_rms
from nlens_video.check.likeness import Likeness, likeness
from nlens_video.check.motion import NOT_KNOWN, Look, Template
from nlens_video.check.regions import SECTORS, Mask, Track, Tracks
from nlens_video.check.shadow import LEAST_TOLERANCE, is_shadow, shadowed
from nlens_video.core.layers import Box, Float32, Float64

NOISE_FACTOR = 6.0  # by which encoding changes textured blocks more than the median one
_FLAT = 1.0  # detail below which only noise differs from frame to frame [level]
_LEAST_BLOCKS = 1.5  # of a sector that is large enough to measure the object's detail [block]
_STRONG = 24.0  # difference of a block that the object covers wholly [level]
_INNER = 6  # power that leaves little of an outline, where the plate is seen beside the object
_CLEARER = 0.6  # misfit of a neighbouring frame of the plate against that of the paired one [1]
_LEAST_GAIN = 0.3  # least difference of these misfits [level]
_RESTS = 3.0  # median change of the plate's blocks from frame to frame, by a still camera [level]
_PASSES = 3.0, 8.0  # times that change, and levels more, of a block in which something moves
_MOST_PASSING = 0.3  # of the blocks; more is the camera
_CUT = 10.0  # mean change of the plate's blocks where another shot begins [level]


@dataclass(slots=True)
class Measures:
    """Measures of all pairs, which are added in order.

    Attributes:
        tick_s: rounding of times by the clocks of both containers [s].
        tracks: the regions in which the result differs.
        dropped: indices of the plate's frames that the result lacks.
        added: indices of the result's frames that the plate lacks.
        shifted: index of each result's frame that shows another frame of the plate, and how many
            frames later that one lies.
        late: index and delay of each result's frame shown at another time than the plate's [s].
        shade: median signed difference of the blocks of each pair, of luma, both colour differences
            and alpha, four numbers a pair [level].
        fades: median change of the plate's light to the frame beside, the larger one, of each of
            these pairs [level].
        compared: index of the result's frame of each of these pairs.
        noise: median difference of a block of each pair, beyond its shade, which is due to
            encoding [level].
        likeness: of the plate in each of these pairs, away from all regions.
        without_alpha: index of the result's frames that lack the plate's alpha.
        cuts: indices of the result's frames at which the plate is another than on the one before.
        worst_late_s: largest delay of a frame [s].
        pairs: compared so far [1].
        previous: the result's frame of the pair before.
        drift: of the largest object over the ground.
    """

    tick_s: float = 0.0

    tracks: Tracks = field(default_factory=Tracks)
    dropped: array[int] = field(default_factory=lambda: array("q"))
    added: array[int] = field(default_factory=lambda: array("q"))
    shifted: list[tuple[int, int]] = field(default_factory=list)
    late: list[tuple[int, float]] = field(default_factory=list)
    shade: array[float] = field(default_factory=lambda: array("d"))
    fades: array[float] = field(default_factory=lambda: array("d"))
    compared: array[int] = field(default_factory=lambda: array("q"))
    noise: array[float] = field(default_factory=lambda: array("d"))
    likeness: list[Likeness] = field(default_factory=list)
    without_alpha: array[int] = field(default_factory=lambda: array("q"))
    cuts: set[int] = field(default_factory=set)
    worst_late_s: float = 0.0
    pairs: int = 0
    previous: FrameFeatures | None = None
    drift: DriftMeasure = field(default_factory=DriftMeasure)

    def add(self, pair: Pair | Unpaired) -> None:
        """Measure the next pair, or count a frame without a partner."""
        if isinstance(pair, Unpaired):
            (self.dropped if pair.dropped else self.added).append(pair.index)
            return
        self.pairs += 1
        self.worst_late_s = max(self.worst_late_s, pair.delay_s, key=abs)
        if abs(pair.delay_s) > self.tick_s:
            self.late.append((pair.result.index, pair.delay_s))
        if _is_cut(pair):
            self.cuts.add(pair.result.index)
        shift = _shift(pair)
        if shift:
            self.shifted.append((pair.result.index, shift))
        else:
            self._compare(pair)
        self.previous = pair.result

    def _compare(self, pair: Pair) -> None:
        signed = np.dstack([pair.result.colour - pair.plate.colour, pair.alpha_change])
        if pair.loses_alpha:
            self.without_alpha.append(pair.result.index)
        shade = np.asarray(np.median(signed, axis=(0, 1)), np.float32)
        difference = np.abs(signed - shade).max(axis=2)
        noise = float(np.median(difference))
        self.noise.append(noise)
        self.shade.extend(shade.tolist())
        self.fades.append(_fade(pair))
        self.compared.append(pair.result.index)
        tolerance = LEAST_TOLERANCE + NOISE_FACTOR * noise
        passing = _passing(pair)
        tracks = self.tracks.follow(pair.result.index, difference, tolerance, passing)
        changed: Mask = np.zeros(difference.shape, bool)
        for track in tracks:
            changed |= track.mask
        gain = _detail_gain(pair, ~changed)
        self.likeness.append(likeness(pair, ~changed))
        motion = None
        if self.previous is not None:
            motion = block_mean(np.abs(pair.result.luma - self.previous.luma))
        largest = max(tracks, key=lambda one: sum(one.area), default=None)
        self.drift.add(pair.plate, pair.result, None if largest is None else largest.mask)
        shadow = shadowed(pair, tolerance)
        look = Look.of(pair.plate, pair.result)
        solid = look.without(shadow)
        for track in tracks:
            _append(track, pair.result, difference, gain, motion)
            blocks = track.mask & ~shadow if (track.mask & ~shadow).any() else track.mask
            box = Box.of(blocks)
            track.boxes.extend((box.x0, box.y0, box.x1, box.y1))
            track.times.append(float(pair.plate.time_s))
            track.strong.append(int((difference[track.mask] > 2.0 * tolerance).sum()))
            self._place(track, look, solid, blocks)
            for mask in (track.mask, blocks):
                inner = _weight(mask, difference) * _share_around(mask) ** _INNER
                track.light.extend(_light(pair.result, inner))
            track.plate_light.extend(_light(pair.plate, np.ones_like(difference)))
            track.shadowed.append(is_shadow(pair, track.mask, tolerance))

    def _place(self, track: Track, look: Look, solid: Look, blocks: Mask) -> None:
        """How far a region has moved since the frame before, and the plate with it.

        Registered with its shadow and without: `solid` and `blocks` are the latter's.
        """
        known = len(track.frames) > 1 and track.frames[-2] == look.index - 1
        step, solid_step = NOT_KNOWN, NOT_KNOWN
        if known:
            whole, inner = track.templates
            step = whole.step(look)
            alike = inner is whole and solid is look
            solid_step = step if alike else inner.step(solid)
        track.steps.extend((*step.tolist(), *solid_step.tolist()))
        track.plate_steps.extend(self.drift.plate_step_px.tolist())
        whole = Template.of(look, track.mask)
        track.templates = whole, whole if solid is look else Template.of(solid, blocks)


def _fade(pair: Pair) -> float:
    beside = [one for one in (pair.before, pair.after) if one is not None]
    changes = [np.median(pair.plate.colour[..., 0] - one.colour[..., 0]) for one in beside]
    return float(np.abs(changes).max(initial=0.0))


def _is_cut(pair: Pair) -> bool:
    """Whether the plate shows something else than on its frame before."""
    if pair.before is None:
        return False
    change = np.abs(pair.plate.colour[..., 0] - pair.before.colour[..., 0])
    return float(change.mean()) > _CUT


def _passing(pair: Pair) -> Mask | None:
    """Blocks in which something moves before a still camera; None where the camera moves."""
    if pair.before is None:
        return None
    change = block_mean(np.abs(pair.plate.luma - pair.before.luma))
    usual = float(np.median(change))
    share, more = _PASSES
    passing = np.asarray(change > share * usual + more, bool)
    return passing if usual < _RESTS and passing.mean() < _MOST_PASSING else None


def _append(
    track: Track, result: FrameFeatures, difference: Float32, gain: float, motion: Float32 | None
) -> None:
    weight = _weight(track.mask, difference)
    area = float(weight.sum())
    # with the blocks beside it: those in which little is covered come and go by encoding
    beside = cv2.dilate(track.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    track.area.append(float(_weight(beside, difference).sum()))
    detail = result.detail / np.float32(gain)
    inside = float((weight * detail).sum()) / max(area, 1e-6)
    track.sharpness.append(float(np.log(_FLAT + inside)))
    track.sectors.extend(_by_sector(weight, detail))
    solid = weight >= 0.5 * weight.max()
    track.motion.append(float("nan") if motion is None else float(motion[solid].mean()))


def _weight(mask: Mask, difference: Float32) -> Float32:
    """How far the object covers each block (h, w) [1]."""
    covered = np.clip(difference / np.float32(_STRONG), 0.0, 1.0)
    return np.asarray(np.float32(mask) * covered, np.float32)


def _share_around(mask: Mask) -> Float32:
    """Share of the 3 x 3 blocks around each one (h, w) that are of the mask [1]."""
    kind = cv2.BORDER_CONSTANT
    return np.asarray(cv2.blur(mask.astype(np.float32), (3, 3), borderType=kind), np.float32)


def _light(features: FrameFeatures, weight: Float32) -> list[float]:
    """Mean red, green and blue of the blocks by their weights (h, w) [level]."""
    total = max(float(weight.sum()), 1e-6)
    return [float((weight * one).sum()) / total for one in features.rgb]


def _by_sector(weight: Float32, detail: Float32) -> Float64:
    """Log of the detail in each sector round the middle, NaN where the object has too few blocks.

    The lens changes all sectors alike; the plate behind the outline and the encoder do not.
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
    """Share of the plate's detail that is left after encoding, which varies between frames."""
    if not plate.any():
        return 1.0
    before = float(pair.plate.detail[plate].sum())
    after = float(pair.result.detail[plate].sum())
    return max(after, 1e-3) / max(before, 1e-3)


def _misfit(result: FrameFeatures, plate: FrameFeatures) -> float:
    """Difference of two frames [level].

    Median over the blocks, so that an object on less than half of them does not count.
    """
    return float(np.median(block_rms(result, plate)))


def _shift(pair: Pair) -> int:
    """1 where the result shows the plate's next frame, -1 its previous one, 0 where its own."""
    own = _misfit(pair.result, pair.plate)
    best, shift = own, 0
    for neighbour, step in ((pair.before, -1), (pair.after, 1)):
        if neighbour is None:
            continue
        misfit = _misfit(pair.result, neighbour)
        if misfit < min(best, _CLEARER * own, own - _LEAST_GAIN):
            best, shift = misfit, step
    return shift
