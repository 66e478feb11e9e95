"""Findings from measures: thresholds on times and plate."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.check.drift import DriftMeasure
from nlens_video.check.likeness import WORDS, fault
from nlens_video.check.measure import NOISE_FACTOR, Measures
from nlens_video.check.regions import Track
from nlens_video.check.shadow import LEAST_TOLERANCE
from nlens_video.check.verdict import Finding, at, runs
from nlens_video.video.info import SourceInfo

PICTURES = ("still", "sequence")
"""Kinds of results that hold neither sound nor a shape of their pixels."""
_SHAPE = 0.01  # log of a ratio of shapes that rounding makes
_SHADOW = 0.9  # share of a shadow's frames on which it is one, and has an object [1]
_WHOLE_PLATE = 3.0  # median difference above that of any sensible encoding [level]
_SHADES = ("light", "blue", "red", "alpha")  # luma, both colour differences, alpha
_SHADE = 0.5  # middle change of all blocks by encoding, whose errors go both ways [level]
_SHADE_OF_NOISE = 0.25  # and more, of the median difference
_SHADE_OF_FADE = 0.1  # and more, of what a fade changes from frame to frame, which encoders predict


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


def judge_shape(plate: SourceInfo, result: SourceInfo) -> list[Finding]:
    """A result whose pixels are displayed in another shape; pictures do not tell theirs."""
    ratio = result.pixel_aspect / plate.pixel_aspect
    if result.kind in PICTURES or abs(math.log(ratio)) < _SHAPE:
        return []
    words = (
        f"the result is displayed {ratio:.2f} times as wide as its plate: its pixels are "
        f"{_shape(result)}, the plate's {_shape(plate)}"
    )
    return [at("plate", None, ratio, words)]


def _shape(info: SourceInfo) -> str:
    ratio = info.uneven_aspect
    return "square" if ratio is None else f"{ratio.numerator}:{ratio.denominator}"


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
    for span in runs(measures.without_alpha):
        words = "the result has no alpha, and the plate is transparent there"
        found.append(at("plate", span, span[1] - span[0] + 1, words))
    noise = float(np.median(measures.noise)) if measures.noise else 0.0
    found += _judge_shade(measures, _SHADE + _SHADE_OF_NOISE * noise)
    found += _judge_likeness(measures)
    if noise > _WHOLE_PLATE:
        found.append(
            at(
                "plate", None, noise,
                f"half of the whole picture differs by more than {noise:.1f} of 255 levels: other "
                "colours, or a very coarse encoding",
            )
        )  # fmt: skip
    return found


def _judge_shade(measures: Measures, limit: float) -> list[Finding]:
    """Frames whose plate as a whole is lighter, darker or of another colour."""
    shade = np.array(measures.shade).reshape(-1, len(_SHADES))
    compared = np.array(measures.compared)
    limits = limit + _SHADE_OF_FADE * np.array(measures.fades)
    found = []
    for span in runs(compared[np.abs(shade).max(axis=1, initial=0.0) > limits].tolist()):
        inside = shade[(compared >= span[0]) & (compared <= span[1])]
        middle = np.median(inside, axis=0)
        worst = int(np.argmax(np.abs(middle)))
        changed = float(middle[worst])
        more = "more" if changed > 0 else "less"
        words = (
            f"the whole plate has {abs(changed):.1f} of 255 levels {more} {_SHADES[worst]} "
            f"(limit {limit:.1f}); give the plate that the result was made from, or look where the "
            "colours change"
        )
        found.append(at("plate", span, changed, words))
    return found


def _judge_likeness(measures: Measures) -> list[Finding]:
    """Frames whose plate as a whole lies elsewhere, or has other detail or colours."""
    faults = [
        fault(one, noise) for one, noise in zip(measures.likeness, measures.noise, strict=True)
    ]
    found = []
    for kind in sorted({one.kind for one in faults if one is not None}):
        sizes = {
            index: one.size
            for index, one in zip(measures.compared, faults, strict=True)
            if one is not None and one.kind == kind
        }
        for first, last in runs(sizes):
            worst = max((sizes[index] for index in range(first, last + 1)), key=abs)
            found.append(at("plate", (first, last), worst, f"the whole plate {WORDS[kind](worst)}"))
    return found


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
