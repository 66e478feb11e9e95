"""Findings from measures: thresholds on times, object, plate and sound."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.check.drift import DriftMeasure
from nlens_video.check.measure import (
    LEAST_TOLERANCE,
    NOISE_FACTOR,
    SOUND_LIMIT_S,
    Measures,
    SoundPair,
)
from nlens_video.check.regions import SECTORS, Track
from nlens_video.check.series import (
    flicker,
    freezes,
    outliers,
    second_difference,
    standard_error,
    steps,
)
from nlens_video.check.verdict import Finding, at, runs
from nlens_video.core.layers import Float64

Frames = npt.NDArray[np.int64]
_STEP = 0.08  # limit of a lasting change within one frame, as a share [1]
_POP = 0.15  # limit of a jump of sharpness or coverage on a single frame, as a share [1]
_FLICKER = 0.015  # limit of the amplitude of flicker, as a share [1]
_SMALL = 0.13  # the same limit times the root of the number of blocks, for small objects
_SHADOW = 0.9  # share of a shadow's frames on which it is one, and has an object [1]
_WHOLE_PLATE = 3.0  # median difference above that of any sensible encoding [level]
_STILL = 0.75  # largest change of a still block of the result from frame to frame [level]


def judge_frames(measures: Measures) -> list[Finding]:
    """Frames that are dropped, added, repeated, or shown at another time."""
    found = []
    for first, last in runs(measures.dropped):
        which = f"frame {first}" if first == last else f"frames {first} to {last}"
        words = f"dropped: the result has no frame for the input's {which}"
        found.append(at("frames", None, last - first + 1, words))
    for span in runs(measures.added):
        words = "added: the input has no frame at that time"
        found.append(at("frames", span, span[1] - span[0] + 1, words))
    for step, words in ((-1, "repeated: shows the plate of the frame before"),
                        (1, "dropped: shows the plate of the frame after")):  # fmt: skip
        for span in runs(index for index, shift in measures.shifted if shift == step):
            found.append(at("frames", span, span[1] - span[0] + 1, words))
    for span in runs(index for index, _ in measures.late):
        worst = max((late for i, late in measures.late if span[0] <= i <= span[1]), key=abs)
        direction = "late" if worst > 0 else "early"
        found.append(at("time", span, worst, f"shown {1e3 * abs(worst):.1f} ms {direction}"))
    return found


def tolerance(measures: Measures) -> float:
    """Difference of a block that encoding alone may make, over all frames [level]."""
    if not measures.noise:
        return 0.0
    return LEAST_TOLERANCE + NOISE_FACTOR * float(np.median(measures.noise))


def objects_among(measures: Measures, count: int) -> list[Track]:
    """The tracks of objects: the largest ones, at most `count` on a frame."""
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
    """The tracks of shadows: the plate with less light, on frames with an object."""
    shown = {index for track in objects for index in track.frames}
    return [
        track
        for track in measures.tracks.all()
        if not any(track is one for one in objects)
        and sum(track.shadowed) >= _SHADOW * len(track.shadowed)
        and sum(index in shown for index in track.frames) >= _SHADOW * len(track.frames)
    ]


def judge_plate(measures: Measures, objects: list[Track]) -> list[Finding]:
    """Changes of the plate away from the objects."""
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
                "give --max-objects 2 or more",
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
    """Jumps, flicker and freezes of one object, but for frames on which something passes it."""
    frames = np.array(track.frames, np.int64)
    span = np.arange(frames[0], frames[-1] + 1)
    found = [
        at("pop", gap, 1.0, "the object is missing")
        for gap in runs(index for index in span.tolist() if index not in set(frames.tolist()))
        if not _beside(track.disturbed, *gap)
    ]
    # an object of few blocks varies more
    blocks = max(float(np.median(np.array(track.area))), 1.0)
    limit = max(_FLICKER, _SMALL / float(np.sqrt(blocks)))
    step_limit = _STEP * limit / _FLICKER
    for name, (values, bend, error) in _series(track, span).items():
        for first, last, amplitude in flicker(bend, limit, error):
            words = f"{name} of the object goes up and down by {amplitude:.1%} (limit {limit:.1%})"
            found.append(at("flicker", (int(span[first]), int(span[last])), amplitude, words))
        jumps = outliers(bend, _POP, error)
        for place, jump in jumps:
            index = int(span[place])
            words = f"{name} of the object jumps by {np.expm1(jump):+.0%} (limit {_POP:.0%})"
            found.append(at("pop", (index, index), jump, words))
        jumped = {place for place, _ in jumps}
        for place, size in steps(values, step_limit):
            if not jumped & {place - 1, place}:
                index = int(span[place])
                words = (
                    f"{name} of the object changes at once by {np.expm1(size):+.0%} and stays so"
                )
                found.append(at("pop", (index, index), size, f"{words} (limit {step_limit:.0%})"))
    motion = _on(span, frames, np.array(track.motion))
    for first, last in freezes(np.nan_to_num(motion), _STILL):
        if _beside(track.disturbed, int(span[first]), int(span[last])):
            continue
        found.append(
            at(
                "freeze", (int(span[first]), int(span[last])), float(motion[first]),
                "the object stands still, and moves before and after",
            )
        )  # fmt: skip
    return found


def _beside(disturbed: set[int], first: int, last: int) -> bool:
    """Whether something passes on some frames or on their neighbours."""
    return not disturbed.isdisjoint(range(first - 1, last + 2))


def judge_drift(drift: DriftMeasure) -> list[Finding]:
    """An object that slides over the plate's ground."""
    if not drift.slides or drift.rms_px is None:
        return []
    text = (
        f"the object slides over the plate's ground by up to {drift.worst_px:.1f} px "
        f"(rms {drift.rms_px:.1f} px)"
    )
    why = (
        "the camera does not follow the plate"
        if drift.solved is not None
        else "it stays at rest in the frame while the plate moves: render it with the plate's own "
        "camera (--camera-from), unless it is to ride with the camera"
    )
    return [at("drift", None, drift.rms_px, f"{text}; {why}")]


def _series(track: Track, span: Frames) -> dict[str, tuple[Float64, Float64, Float64]]:
    """Log of sharpness and coverage on every frame of the span, its bend and standard error.

    Coverage is not judged where the object touches the frame's edge, which crops it, and neither is
    where something passes.
    """
    frames = np.array(track.frames, np.int64)
    clear = np.array([not _beside(track.disturbed, index, index) for index in track.frames])
    sectors = second_difference(_on(span, frames, np.array(track.sectors).reshape(-1, SECTORS)))
    sharpness = _on(span, frames, np.where(clear, np.array(track.sharpness), np.nan))
    log_area = np.log(np.maximum(np.array(track.area), 1e-3))
    area = _on(span, frames, np.where(clear & np.array(track.whole, bool), log_area, np.nan))
    return {
        "sharpness": (
            sharpness,
            np.nan_to_num(second_difference(sharpness)),
            standard_error(sectors),
        ),
        "coverage": (area, np.nan_to_num(second_difference(area)), np.zeros(len(span))),
    }


def median_bends(track: Track) -> tuple[float, float]:
    """Median |bend| of an object's sharpness and coverage, as shares [1]."""
    series = _series(track, np.arange(track.first, track.last + 1)).values()
    sharpness, coverage = (float(np.median(np.abs(bend))) for _, bend, _ in series)
    return sharpness, coverage


def judge_sound(pairs: list[SoundPair], missing: int) -> list[Finding]:
    """Sound that is missing, shifted, or of another length."""
    found = []
    if missing:
        found.append(at("sound", None, missing, f"{missing} audio stream(s) of the input missing"))
    for number, pair in enumerate(pairs):
        start, end, most = pair.shifts_s
        for shift, words in ((start, "starts"), (end, "ends"), (most, "lies at most")):
            if abs(shift) > SOUND_LIMIT_S:
                direction = "late" if shift > 0 else "early"
                text = f"audio {number} {words} {1e3 * abs(shift):.0f} ms {direction}"
                limit = f"(limit {1e3 * SOUND_LIMIT_S:.0f} ms)"
                found.append(at("sound", None, shift, f"{text} {limit}"))
    return found


def _on(span: Frames, frames: Frames, values: Float64) -> Float64:
    """Values on every frame of the span, NaN where the region was not found."""
    whole = np.full((len(span), *values.shape[1:]), np.nan)
    whole[frames - span[0]] = values
    return whole
