"""From measures to findings: what is wrong, where, by how much."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.check.findings import Finding, at, runs
from nlens_video.check.measure import LEAST_TOLERANCE, NOISE_FACTOR, Measures
from nlens_video.check.regions import SECTORS, Track
from nlens_video.check.series import (
    flicker,
    freezes,
    outliers,
    second_difference,
    standard_error,
    steps,
)
from nlens_video.check.sound import LIMIT_S, SoundPair
from nlens_video.core.layers import Float64

Frames = npt.NDArray[np.int64]
STEP = 0.08  # change of level from one frame to the next, as a share [1]
POP = 0.15  # jump of sharpness or coverage that a single frame may make, as a share [1]
FLICKER = 0.015  # amplitude that they may go up and down by, as a share [1]
_SMALL = 0.13  # and that divided by the root of the object's blocks, where it has few
_DIMMED = 0.9  # of its frames on which a shadow is one, and has its object [1]
_WHOLE_PLATE = 3.0  # median difference that no sensible encoding makes [level]
_STILL = 0.75  # change of a still block of the result from frame to frame, at most [level]


def judge_frames(measures: Measures) -> list[Finding]:
    """Frames that are missing, too many, or show another moment."""
    found = [
        at("frames", None, last - first + 1, f"dropped: the result has no frame for {_input(span)}")
        for span in runs(measures.dropped)
        for first, last in [span]
    ]
    found += [
        at("frames", span, span[1] - span[0] + 1, "added: the input has no frame at that time")
        for span in runs(measures.added)
    ]
    for step, words in ((-1, "repeated: shows the plate of the frame before"),
                        (1, "dropped: shows the plate of the frame after")):  # fmt: skip
        for span in runs(index for index, shift in measures.shifted if shift == step):
            found.append(at("frames", span, span[1] - span[0] + 1, words))
    for span in runs(index for index, _ in measures.late):
        worst = max((off for i, off in measures.late if span[0] <= i <= span[1]), key=abs)
        direction = "late" if worst > 0 else "early"
        found.append(at("time", span, worst, f"shown {1e3 * abs(worst):.1f} ms {direction}"))
    return found


def tolerance(measures: Measures) -> float:
    """Difference of a block that encoding may make, over all frames [level]."""
    if not measures.noise:
        return 0.0
    return LEAST_TOLERANCE + NOISE_FACTOR * float(np.median(measures.noise))


def objects_among(measures: Measures, count: int) -> list[Track]:
    """The tracks that are objects: at most `count` at a time, those that cover most."""
    chosen: list[Track] = []
    least = tolerance(measures)
    for track in measures.tracks.all():
        if track.worst <= least:
            continue
        beside = [one for one in chosen if one.first <= track.last and track.first <= one.last]
        long = len(track.frames) > 1 or measures.pairs <= 2
        if len(beside) < count and long:
            chosen.append(track)
    return chosen


def shadows_among(measures: Measures, objects: list[Track]) -> list[Track]:
    """The tracks that only take light from the plate, always beside an object."""
    shown = {index for track in objects for index in track.frames}
    return [
        track
        for track in measures.tracks.all()
        if not any(track is one for one in objects)
        and sum(track.dimmed) >= _DIMMED * len(track.dimmed)
        and sum(index in shown for index in track.frames) >= _DIMMED * len(track.frames)
    ]


def judge_plate(measures: Measures, objects: list[Track]) -> list[Finding]:
    """Changes away from the objects."""
    found = []
    least = tolerance(measures)
    shadows = shadows_among(measures, objects)
    for track in measures.tracks.all():
        if track.worst <= least or any(track is one for one in (*objects, *shadows)):
            continue
        x, y, width, height = track.box_px
        found.append(
            at(
                "plate", (track.first, track.last), track.worst,
                f"{width}x{height} px at {x},{y} differ by up to {track.worst:.1f} of 255 levels "
                f"(tolerance {least:.1f}) away from the object; if that is another object, "
                "say --objects 2 or more",
            )
        )  # fmt: skip
    noise = float(np.median(measures.noise)) if measures.noise else 0.0
    if noise > _WHOLE_PLATE:
        found.append(
            at(
                "plate", None, noise,
                f"half of the whole picture differs by more than {noise:.1f} of 255 levels: other "
                "colours, or a very coarse encoding",
            )
        )  # fmt: skip
    return found


def judge_object(track: Track) -> list[Finding]:
    """Jumps, flicker and freezes of one object."""
    frames = np.array(track.frames, np.int64)
    span = np.arange(frames[0], frames[-1] + 1)
    found = [
        at("pop", gap, 1.0, "the object is missing")
        for gap in runs(index for index in span.tolist() if index not in set(frames.tolist()))
    ]
    limit = flicker_limit(track)
    least = STEP * limit / FLICKER  # few blocks change by more of themselves
    for name, (values, bent, error) in _series(track, span).items():
        for first, last, amplitude in flicker(bent, limit, error):
            frames_hit = (int(span[first]), int(span[last]))
            words = f"{name} of the object goes up and down by {amplitude:.1%} (limit {limit:.1%})"
            found.append(at("flicker", frames_hit, amplitude, words))
        for place, jump in outliers(bent, POP, error):
            index = int(span[place])
            words = f"{name} of the object jumps by {np.expm1(jump):+.0%} (limit {POP:.0%})"
            found.append(at("pop", (index, index), jump, words))
        jumped = {place for place, _ in outliers(bent, POP, error)}
        for place, size in steps(values, least):
            if not jumped & {place - 1, place}:
                index = int(span[place])
                words = (
                    f"{name} of the object changes at once by {np.expm1(size):+.0%} and stays so"
                )
                found.append(at("pop", (index, index), size, f"{words} (limit {least:.0%})"))
    motion = _on(span, frames, np.array(track.motion))
    for first, last in freezes(np.nan_to_num(motion), _STILL):
        found.append(
            at(
                "freeze", (int(span[first]), int(span[last])), float(motion[first]),
                "the object stands still, and moves before and after",
            )
        )  # fmt: skip
    return found


def flicker_limit(track: Track) -> float:
    """Amplitude below which an object of that size is steady, as a share [1]."""
    return max(FLICKER, _SMALL / float(np.sqrt(max(np.median(np.array(track.area)), 1.0))))


def _series(track: Track, span: Frames) -> dict[str, tuple[Float64, Float64, Float64]]:
    """Values, bend and its standard error of the two series, on every frame of the span.

    How much of an object that touches the frame's edge is covered is the edge's doing: not judged.
    """
    frames = np.array(track.frames, np.int64)
    sectors = second_difference(_on(span, frames, np.array(track.sectors).reshape(-1, SECTORS)))
    sharpness = _on(span, frames, np.array(track.sharpness))
    log_area = np.log(np.maximum(np.array(track.area), 1e-3))
    area = _on(span, frames, np.where(np.array(track.whole, bool), log_area, np.nan))
    return {
        "sharpness": (
            sharpness,
            np.nan_to_num(second_difference(sharpness)),
            standard_error(sectors),
        ),
        "coverage": (area, np.nan_to_num(second_difference(area)), np.zeros(len(span))),
    }


def restless(track: Track) -> tuple[float, float]:
    """Median |bend| of an object's sharpness and coverage, as shares [1]."""
    series = _series(track, np.arange(track.first, track.last + 1)).values()
    sharpness, coverage = (float(np.median(np.abs(bent))) for _, bent, _ in series)
    return sharpness, coverage


def judge_sound(pairs: list[SoundPair], missing: int) -> list[Finding]:
    """Sound that is missing, moved, or of another length."""
    found = []
    if missing:
        found.append(at("sound", None, missing, f"{missing} audio stream(s) of the input missing"))
    for number, pair in enumerate(pairs):
        start, end, most = pair.shifts_s
        for off, words in ((start, "starts"), (end, "ends"), (most, "lies at most")):
            if abs(off) > LIMIT_S:
                direction = "late" if off > 0 else "early"
                text = f"audio {number} {words} {1e3 * abs(off):.0f} ms {direction}"
                found.append(at("sound", None, off, f"{text} (limit {1e3 * LIMIT_S:.0f} ms)"))
    return found


def _on(span: Frames, frames: Frames, values: Float64) -> Float64:
    """Values on every frame of the span, NaN where the region was not seen."""
    whole = np.full((len(span), *values.shape[1:]), np.nan)
    whole[frames - span[0]] = values
    return whole


def _input(span: tuple[int, int]) -> str:
    first, last = span
    return (
        f"the input's frame {first}" if first == last else f"the input's frames {first} to {last}"
    )
