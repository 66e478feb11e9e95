"""Sentences of the report: the fitted lens, and warnings and notes with their remedies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from msgspec import Struct

from nlens_video.core.errors import NoteKind, kind_of
from nlens_video.core.lens_fit import LensFit
from nlens_video.report.findings import Findings, MainFrame
from nlens_video.report.fit import margin_words, object_disparity, unit_name

_SEEN_SHARE, _SEEN_PX = 0.15, 1.0  # visible errors of the CoC: the larger one counts
_FEW_INLIERS = 0.5
_MET = 0.9  # share of frames within the budget that needs no note

_REMEDIES = {
    NoteKind.OTHER: "If the picture looks wrong, change this in the GLB or the plate.",
    NoteKind.INFORMATION: "",
    NoteKind.UNCERTAIN: "",
    NoteKind.CAMERA: "Name the camera with --camera if another one was meant.",
    NoteKind.FOOTPRINT_UNSEEN: (
        "Start on a frame with the object wholly in view (--range), or give --ground-y."
    ),
    NoteKind.LIGHTS_MISSING: "Give the GLB punctual lights that match those of the plate.",
    NoteKind.LIGHTS_LIMITED: "Remove those lights from the GLB that add little.",
    NoteKind.STREAM_LEFT_OUT: "Add that stream to the output afterwards if it is needed.",
}


class Advice(Struct, frozen=True):
    """A warning or a note, and what to do about it.

    Attributes:
        kind: a warning where the result may be wrong.
        text: what was found.
        remedy: what to do; empty where nothing is.
    """

    kind: Literal["warning", "note"]
    text: str
    remedy: str


def lens_sentences(findings: Findings) -> str:
    """The lens in plain words: focus, and how the object lies to it."""
    fit = findings.fit
    if fit is None:
        return findings.no_fit_reason
    if fit.slope == 0:
        return f"A constant CoC of {abs(fit.intercept):.1f} px is used at every depth."
    focus = fit.focus_disparity
    unit = unit_name(findings.session.context.unit_m)
    where = f"at {1 / focus:.3g} {unit} from the camera" if focus > 0 else "at infinity"
    return f"The plate is in focus {where}. {_object_sentence(fit, findings.main, unit)}".strip()


def advice(findings: Findings) -> list[Advice]:
    """Warnings about fit, plate and times, then notes."""
    found = [*_lens_advice(findings), *_run_advice(findings)]
    return sorted(found, key=lambda one: one.kind == "note")


def _object_sentence(fit: LensFit, main: MainFrame | None, unit: str) -> str:
    ends = object_disparity(main)
    if main is None or ends is None:
        return ""
    far, near = (float(end) for end in fit.coc_px(np.array(ends, np.float32)))
    if far >= 0:
        side = "in front of the focal plane"
    elif near <= 0:
        side = "behind the focal plane"
    else:
        side = "across the focal plane"
    least = 0.0 if far < 0 < near else min(abs(far), abs(near))
    most = max(abs(far), abs(near))
    return (
        f"On frame {main.index} the object stands {side}, {1 / ends[1]:.3g} to "
        f"{1 / ends[0]:.3g} {unit} away, and its circle of confusion (CoC) is "
        f"{least:.1f} to {most:.1f} px wide."
    )


def _lens_advice(findings: Findings) -> Iterator[Advice]:
    fit = findings.fit
    if fit is None:
        return
    if fit.slope == 0:
        yield Advice(
            "warning",
            "No relation between depth and CoC was found, so near and far parts of the object "
            f"are blurred alike. {findings.doubt}".strip(),
            "Use a frame on which more of the ground is seen (--range), check --ground-y, or "
            "measure the lens on another shot and give it with --fit.",
        )
        return
    yield from _regression_advice(findings, fit)
    if fit.sign != "resolved":
        how = "was assumed" if fit.sign == "assumed" else "hardly follows from the picture"
        yield Advice(
            "warning",
            f"Whether the object is in front of or behind the focal plane {how} "
            f"({margin_words(fit)}).",
            "Compare the object with what lies beside it in the plate. If it is on the wrong "
            f"side, {_other_side(fit)}",
        )


def _other_side(fit: LensFit) -> str:
    """How to get the lens of the other sign."""
    if fit.other is None:
        return (
            "measure on a frame with more depth of ground in view (--range) and reuse that fit "
            "with --save-fit and --fit."
        )
    slope, intercept = fit.other
    nearer = intercept * fit.slope < fit.intercept * slope
    return f"--prefer {'near' if nearer else 'far'} takes the other lens that explains the plate."


def _regression_advice(findings: Findings, fit: LensFit) -> Iterator[Advice]:
    regression = findings.regression
    if regression is None:
        return
    samples = regression.samples
    there = samples.anchor if samples.anchor.any() else np.ones_like(samples.anchor)
    middle = np.array([np.median(samples.disparity[there])])
    error, coc = float(fit.coc_stderr_px(middle)[0]), abs(float(fit.coc_px(middle)[0]))
    seen = max(_SEEN_PX, _SEEN_SHARE * coc)
    if error > seen:
        yield Advice(
            "warning",
            f"The CoC where the object stands is known to {error:.1f} px only.",
            "Use a frame with more texture on the ground or more of it in view (--range).",
        )
    differences = samples.coc_px[there] - np.abs(fit.coc_px(samples.disparity[there]))
    if abs(difference := float(np.median(differences))) > seen:
        yield Advice(
            "warning",
            f"Where the object stands, the plate is {abs(difference):.1f} px "
            f"{'more' if difference > 0 else 'less'} blurred than the fitted lens says.",
            "Check --ground-y and the camera. A smooth ground, motion blur or strong compression "
            "of the plate do the same: try another frame (--range).",
        )
    if fit.inlier_fraction < _FEW_INLIERS:
        yield Advice(
            "warning",
            f"Only {fit.inlier_fraction:.0%} of the ground agrees with the fitted lens.",
            "Check that the ground of the GLB is the ground of the plate (--ground-y), and that "
            "the camera matches; real objects on the ground matter less.",
        )


def _run_advice(findings: Findings) -> Iterator[Advice]:
    """On the plate, the time and what the run has noted."""
    info, summary = findings.info, findings.summary
    if info.tags.assumed and info.tags.matrix != "gbr":  # RGB without tags is sRGB
        yield Advice(
            "note",
            f"The plate has no colour tags; assumed {', '.join(info.tags.assumed)}.",
            "If the object's colours look off, tag the plate with its real values.",
        )
    once = {node.name for node in findings.session.graph.nodes if node.once}
    once.add("measure")  # effects, before a shot's first frame
    steady = {name: ms for name, ms in summary.node_median_ms.items() if name not in once}
    if summary.frames > 1 and summary.within_budget < _MET and steady:
        node = max(steady, key=lambda name: steady[name])
        yield Advice(
            "note",
            f"{summary.within_budget:.0%} of the frames kept the budget of "
            f"{summary.budget_ms:g} ms; {node} costs most ({steady[node]:.0f} ms).",
            "Choose a cheaper --preset, or a larger --budget-ms.",
        )
    for note in findings.notes:
        if note == findings.doubt and findings.fit is not None and findings.fit.slope == 0:
            continue
        kind = kind_of(note)
        yield Advice(
            "warning" if kind is NoteKind.UNCERTAIN else "note",
            note[:1].upper() + note[1:] + ".",
            _REMEDIES[kind],
        )
