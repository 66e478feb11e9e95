"""Findings on an object over time: jumps, steps, flicker and freezes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.check.presence import judge_freezes
from nlens_video.check.regions import SECTORS, Track, beside
from nlens_video.check.series import (
    flicker,
    lone_jumps,
    lone_offset,
    outliers,
    second_difference,
    standard_error,
    steps,
    undone,
)
from nlens_video.check.verdict import Finding, at
from nlens_video.core.layers import Float64

Frames = npt.NDArray[np.int64]
_STEP = 0.08  # limit of a lasting change within one frame, as a share [1]
_POP = 0.15  # limit of a jump on a single frame, as a share [1]
_FLICKER = 0.015  # limit of the amplitude of flicker, as a share [1]
_SMALL = 0.13  # the same limit times the root of the number of blocks, for small objects
_SMALL_BY_NOISE = 0.08  # that one for each level of noise: blocks at the outline vary with it
_JUMP_PX, _JITTER_PX = 0.75, 0.4  # limits of a place on a single frame, and of its amplitude [px]
_TURN_PX = 2.0  # change of its step from frame to frame that changes an object's motion blur [px]
_ENTERS = 1.5  # times as much of an object that the frame's edge crops, from frame to frame [1]
_FINE = 1.0  # noise of encoding up to which these limits hold; they grow with it [level]
_DARK = 8.0  # light below which noise would be a change [level]
_COLOURS = ("red", "green", "blue")


class _Series(Struct, frozen=True):
    """One quantity on every frame of a span.

    Attributes:
        values: its logarithm (n,), measured in one or more ways; a change shows in all of them.
        bend: its difference from the mean of its neighbours, (n,).
        error: standard error of the bend.
    """

    values: tuple[Float64, ...]
    bend: Float64
    error: Float64 | float = 0.0


class _Way(Struct, frozen=True):
    """The place along one axis, on every frame of a span.

    Attributes:
        bend: of the place, (n,) [px].
        undone: the part of it that the neighbours undo, (n,) [px].
        offset: how far it lies off its way alone, (n,) [px].
    """

    bend: Float64
    undone: Float64
    offset: Float64


def judge_object(track: Track, noise: float) -> list[Finding]:
    """Jumps, flicker and freezes of one object, but for frames on which something passes it.

    Args:
        track: of the object.
        noise: median difference of a block that is due to encoding [level].
    """
    frames = np.array(track.frames, np.int64)
    span = np.arange(frames[0], frames[-1] + 1)
    found = []
    # an object of few blocks varies more, and one that is coarsely encoded
    blocks = max(float(np.median(np.array(track.area))), 1.0)
    limit = max(_FLICKER, max(_SMALL, _SMALL_BY_NOISE * noise) / float(np.sqrt(blocks)))
    coarse = max(1.0, noise / _FINE)
    changing = _changing(track)
    for name, series in _series(track, span).items():
        of_share = _judge_share(name, series, span, limit)
        found += [
            one
            for one in of_share
            if name != "sharpness" or one.kind != "pop" or one.frame not in changing
        ]
    found += _judge_light(_lights(track, span), span, limit)
    still = judge_freezes(track)
    frozen = {index for one in still for index in range(one.frame or 0, (one.last or 0) + 1)}
    found += _strongest(
        [
            one
            for way in _ways(track, span)
            for one in _judge_place(way, span, coarse)
            if one.frame not in frozen  # which leaves its way for this frame
        ]
    )
    return found + still


def median_bends(track: Track) -> tuple[float, float]:
    """Median |bend| of an object's sharpness and coverage, as shares [1]."""
    series = _series(track, np.arange(track.first, track.last + 1)).values()
    sharpness, coverage = (float(np.median(np.abs(one.bend))) for one in series)
    return sharpness, coverage


def _judge_share(name: str, series: _Series, span: Frames, limit: float) -> list[Finding]:
    """Flicker, jumps and steps of a quantity whose changes count by their share."""
    found = []
    for first, last, amplitude in flicker(series.bend, limit, series.error):
        words = f"{name} of the object goes up and down by {amplitude:.1%} (limit {limit:.1%})"
        found.append(at("flicker", (int(span[first]), int(span[last])), amplitude, words))
    step_limit = _STEP * limit / _FLICKER
    own, *against = (dict(steps(values, step_limit)) for values in series.values)
    lasting = {place: size for place, size in own.items() if all(place in one for one in against)}
    for place, size in lasting.items():
        index = int(span[place])
        words = f"{name} of the object changes at once by {np.expm1(size):+.0%} and stays so"
        found.append(at("pop", (index, index), size, f"{words} (limit {step_limit:.0%})"))
    for place, jump in outliers(series.bend, _POP, series.error):
        if lasting.keys().isdisjoint((place, place + 1)):  # a step bends the values on both sides
            index = int(span[place])
            words = f"{name} of the object jumps by {np.expm1(jump):+.0%} (limit {_POP:.0%})"
            found.append(at("pop", (index, index), jump, words))
    return found


def _judge_light(lights: list[_Series], span: Frames, limit: float) -> list[Finding]:
    """Flicker, jumps and steps of red, green and blue; what all of them do is of the light."""
    by_colour = [
        _judge_share(f"{name} light", of, span, limit)
        for name, of in zip(_COLOURS, lights, strict=True)
    ]
    strongest = _strongest([one for found in by_colour for one in found])
    return [_without_colour(one) if _in_all(one, by_colour) else one for one in strongest]


def _in_all(one: Finding, by_colour: list[list[Finding]]) -> bool:
    return all(any(_overlap(one, other) for other in found) for found in by_colour)


def _without_colour(one: Finding) -> Finding:
    text = one.text
    for name in _COLOURS:
        text = text.replace(f"{name} light", "light")
    return replace(one, text=text)


def _judge_place(way: _Way, span: Frames, coarse: float) -> list[Finding]:
    """Jumps and jitter of the place along one axis; the limits are `coarse` times the usual."""
    jitter_px, jump_px = coarse * _JITTER_PX, coarse * _JUMP_PX
    found = []
    for first, last, amplitude in flicker(way.undone, jitter_px):
        words = f"the object goes to and fro by {amplitude:.1f} px (limit {jitter_px:.2g} px)"
        found.append(at("flicker", (int(span[first]), int(span[last])), amplitude, words))
    for place, jump in lone_jumps(way.offset, way.bend, jump_px):
        index = int(span[place])
        words = f"the object lies {abs(jump):.1f} px off its way (limit {jump_px:.2g} px)"
        found.append(at("pop", (index, index), jump, words))
    return found


def _strongest(findings: list[Finding]) -> list[Finding]:
    """Of findings of one kind on common frames, which one event causes, the strongest."""
    kept: list[Finding] = []
    for one in sorted(findings, key=lambda one: -abs(one.value)):
        if not any(_overlap(one, other) for other in kept):
            kept.append(one)
    return sorted(kept, key=lambda one: one.frame or 0)


def _overlap(one: Finding, other: Finding) -> bool:
    spans = (one.frame or 0, one.last or 0), (other.frame or 0, other.last or 0)
    return one.kind == other.kind and spans[0][0] <= spans[1][1] and spans[1][0] <= spans[0][1]


def _series(track: Track, span: Frames) -> dict[str, _Series]:
    """Sharpness and coverage.

    Both are held against the plate's light too, which changes an object's contrast. Coverage is not
    judged where the object without its shadow touches the frame's edge, which crops it, and neither
    is where something passes.
    """
    frames, clear = np.array(track.frames, np.int64), _clear(track)
    sectors = second_difference(_on(span, frames, np.array(track.sectors).reshape(-1, SECTORS)))
    sharpness = _on(span, frames, np.where(clear, np.array(track.sharpness), np.nan))
    log_area = np.log(np.maximum(np.array(track.area), 1e-3))
    area = _on(span, frames, np.where(clear & track.whole, log_area, np.nan))
    plate = np.array(track.plate_light).reshape(len(frames), -1).mean(axis=1)
    light, times = _on(span, frames, np.log(np.hypot(_DARK, plate))), _times(track, span)
    kinds = {
        name: (values, values - light)
        for name, values in (("sharpness", sharpness), ("coverage", area))
    }
    bends = {name: _least([_bend(one, times) for one in kind]) for name, kind in kinds.items()}
    errors = {"sharpness": standard_error(sectors)}
    return {name: _Series(kinds[name], bends[name], errors.get(name, 0.0)) for name in kinds}


def _lights(track: Track, span: Frames) -> list[_Series]:
    """Mean red, green and blue of the object: with its shadow, without, and against the plate's.

    They are judged where coverage is.
    """
    clear = _clear(track) & track.whole
    own, plate = (
        np.log(np.hypot(_DARK, np.array(one).reshape(len(clear), -1, len(_COLOURS))))
        for one in (track.light, track.plate_light)
    )
    kinds = np.concatenate([own, own - plate], axis=1)
    whole = _on(
        span, np.array(track.frames, np.int64), np.where(clear[:, None, None], kinds, np.nan)
    )
    found, times = [], _times(track, span)
    for colour in np.moveaxis(whole, 2, 0):
        values = tuple(colour.T)
        found.append(_Series(values, _least([_bend(one, times) for one in values])))
    return found


def _ways(track: Track, span: Frames) -> list[_Way]:
    """The object's way, right and down.

    What it shares with the plate is the camera's, what it does with its shadow alone the shadow's.
    """
    clear = _clear(track)
    own, plate = (
        np.array(one).reshape(len(clear), -1, 2) for one in (track.steps, track.plate_steps)
    )
    kinds = np.where(clear[:, None, None], np.concatenate([own, own - plate], axis=1), np.nan)
    step = _on(span, np.array(track.frames, np.int64), kinds)
    times = _times(track, span)
    share = (np.diff(times)[:-1] / (times[2:] - times[:-2]))[:, None, None]
    bend = np.zeros(step.shape)
    bend[1:-1] = np.nan_to_num((1.0 - share) * step[1:-1] - share * step[2:])
    return [
        _Way(
            bend=_least(list(axis.T)),
            undone=_least([undone(kind) for kind in axis.T]),
            offset=_least([lone_offset(kind, times) for kind in axis.T]),
        )
        for axis in np.moveaxis(bend, 2, 0)
    ]


def _times(track: Track, span: Frames) -> Float64:
    """Times of the frames of a span, (n,), NaN where the region was not found [s]."""
    return _on(span, np.array(track.frames, np.int64), np.array(track.times))


def _changing(track: Track) -> set[int]:
    """Frames round which an object's sharpness changes by itself.

    It starts, stops or turns round at once, which changes its motion blur, or it enters or leaves
    the frame.
    """
    frames = np.array(track.frames, np.int64)
    step = np.array(track.steps).reshape(len(frames), -1, 2)[:, 0]
    area = np.log(np.maximum(np.array(track.area), 1e-3))
    follows = np.diff(frames) == 1
    turns = follows & (np.linalg.norm(np.diff(step, axis=0), axis=1) > _TURN_PX)
    enters = follows & ~track.whole[1:] & (np.abs(np.diff(area)) > np.log(_ENTERS))
    return {
        int(index) + shift
        for index in frames[1:][turns | enters]
        for shift in (-2, -1, 0, 1)  # the blur of a frame is that of its open shutter
    }


def _clear(track: Track) -> npt.NDArray[np.bool_]:
    """Frames on which nothing passes, nor on their neighbours."""
    return np.array([not beside(track.disturbed, index, index) for index in track.frames])


def _bend(values: Float64, times: Float64) -> Float64:
    return np.asarray(np.nan_to_num(second_difference(values, times)))


def _least(bends: list[Float64]) -> Float64:
    """Of some bends the one nearest to 0; 0 where they go different ways."""
    every = np.stack(bends)
    nearest = np.sign(every[0]) * np.abs(every).min(axis=0)
    return np.where(np.abs(np.sign(every).sum(axis=0)) == len(every), nearest, 0.0)


def _on(span: Frames, frames: Frames, values: Float64) -> Float64:
    """Values on every frame of the span, NaN where the region was not found."""
    whole = np.full((len(span), *values.shape[1:]), np.nan)
    whole[frames - span[0]] = values
    return whole
