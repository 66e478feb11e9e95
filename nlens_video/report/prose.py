"""Sentences of the report: the fitted lens, and warnings and notes with their remedies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlens_video.core.errors import NoteKind, kind_of
from nlens_video.core.lens_fit import LensFit
from nlens_video.report.findings import Findings, Shown
from nlens_video.report.fit_plot import FitCurve, object_disparity

_SEEN_SHARE, _SEEN_PX = 0.15, 1.0  # errors of the blur that begin to be seen: the larger counts
_FEW_INLIERS = 0.5
_MET = 0.9

_REMEDIES = {
    NoteKind.OTHER: "If the picture looks wrong, change this in the GLB or the plate.",
    NoteKind.INFORMATION: "",
    NoteKind.CAMERA: "Name the camera with --camera if another one was meant.",
    NoteKind.FOOTPRINT_UNSEEN: (
        "Start on a frame with the object wholly in view (--range), or give --ground-y."
    ),
    NoteKind.LIGHTS_MISSING: "Give the GLB punctual lights that match those of the plate.",
    NoteKind.LIGHTS_LIMITED: "Remove those lights from the GLB that add little.",
    NoteKind.STREAM_LEFT_OUT: "Add that stream to the output afterwards if it is needed.",
}
NEVER_SEEN = "No frame was composited: the object was never in view."


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """Something to know and what to do about it.

    Attributes:
        kind: whether the result may be wrong for it.
        text: what it is.
        remedy: what to do; empty where nothing needs doing.
    """

    kind: Literal["warning", "note"]
    text: str
    remedy: str


def no_fit_reason(findings: Findings) -> str:
    """Why parts about the lens are missing; empty where none is."""
    if findings.shot.plate_coc is not None:
        return ""
    if findings.fit is not None:
        return (
            "The lens was given with --fit, so nothing was measured on this plate. "
            "Leave --fit out to see the measurement."
        )
    for decision in findings.session.decisions:
        if decision.effect == "defocus" and not decision.wanted:
            return f"Defocus was not simulated ({decision.reason}), so no lens was measured."
    return (
        "The object was never in view, so no lens was measured. "
        "Check the camera of the GLB (--camera) and --range."
    )


def lens_sentences(findings: Findings) -> str:
    """The lens in plain words."""
    fit = findings.fit
    if fit is None:
        return no_fit_reason(findings)
    if fit.slope == 0:
        return f"The same blur of {abs(fit.intercept):.1f} px is used at every depth."
    focus = fit.focus_disparity
    where = f"at {1 / focus:.3g} m from the camera" if focus > 0 else "at infinity"
    return f"The plate is in focus {where}. {_object_sentence(fit, findings.shown)}".strip()


def advice(findings: Findings) -> list[Advice]:
    """All there is to know, warnings first."""
    found = [
        *_lens_advice(findings),
        *_plate_advice(findings),
        *_time_advice(findings),
        *_note_advice(findings),
    ]
    return sorted(found, key=lambda one: one.kind == "note")


def margin_words(fit: LensFit) -> str:
    """How well the other sign would do."""
    if not np.isfinite(fit.sign_margin):
        return "no lens of the other side fits at all"
    if fit.sign_margin >= 1:
        return f"the other side fits {1 + fit.sign_margin:.2g} times as badly"
    return f"the other side fits {fit.sign_margin:.0%} worse"


def _object_sentence(fit: LensFit, shown: Shown | None) -> str:
    ends = object_disparity(shown)
    if shown is None or ends is None:
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
        f"On frame {shown.index} the object stands {side}, {1 / ends[1]:.3g} to "
        f"{1 / ends[0]:.3g} m away, and its blur is {least:.1f} to {most:.1f} px wide."
    )


def _lens_advice(findings: Findings) -> Iterator[Advice]:
    fit = findings.fit
    if fit is None:
        return
    if fit.slope == 0:
        yield Advice(
            kind="warning",
            text="No relation between depth and blur was found, so near and far parts of the "
            f"object are blurred alike. {findings.doubt}".strip(),
            remedy="Use a frame on which more of the ground is seen (--range), check --ground-y, "
            "or measure the lens on another shot and give it with --fit.",
        )
        return
    yield from _strength_advice(findings, fit)
    if fit.sign != "resolved":
        how = "was assumed" if fit.sign == "assumed" else "hardly follows from the picture"
        yield Advice(
            kind="warning",
            text=f"Whether the object is in front of or behind the focal plane {how} "
            f"({margin_words(fit)}).",
            remedy="Compare the object with what lies beside it in the plate. If it is on the "
            "wrong side, measure on a frame with more depth of ground in view (--range) and "
            "reuse that fit with --save-fit and --fit.",
        )


def _strength_advice(findings: Findings, fit: LensFit) -> Iterator[Advice]:
    regression = findings.regression
    if regression is None:
        return
    samples = regression.samples
    there = samples.anchor if samples.anchor.any() else np.ones_like(samples.anchor)
    middle = np.array([np.median(samples.disparity[there])])
    curve = FitCurve.of(fit, samples)
    error, blur = float(curve.stderr_px(middle)[0]), abs(float(curve.coc_px(middle)[0]))
    seen = max(_SEEN_PX, _SEEN_SHARE * blur)
    if error > seen:
        yield Advice(
            kind="warning",
            text=f"The blur where the object stands is known to {error:.1f} px only.",
            remedy="Use a frame with more texture on the ground or more of it in view (--range).",
        )
    differences = samples.coc_px[there] - np.abs(curve.coc_px(samples.disparity[there]))
    if abs(difference := float(np.median(differences))) > seen:
        yield Advice(
            kind="warning",
            text=f"Where the object stands, the plate looks {abs(difference):.1f} px "
            f"{'more' if difference > 0 else 'less'} blurred than the fitted lens says.",
            remedy="Check --ground-y and the camera. A smooth ground, motion blur or strong "
            "compression of the plate do the same: try another frame (--range).",
        )
    if fit.inlier_fraction < _FEW_INLIERS:
        yield Advice(
            kind="warning",
            text=f"Only {fit.inlier_fraction:.0%} of the ground agrees with the lens that was "
            "found.",
            remedy="Check that the ground of the GLB is the ground of the plate (--ground-y), "
            "and that the camera matches; objects in the way matter less.",
        )


def _plate_advice(findings: Findings) -> Iterator[Advice]:
    info = findings.info
    if info.tags.assumed and info.tags.matrix != "gbr":  # RGB without tags is sRGB
        yield Advice(
            kind="note",
            text=f"The plate does not say its colour; assumed {', '.join(info.tags.assumed)}.",
            remedy="If the object's colours look off, tag the plate with its real values.",
        )
    if info.interlaced:
        yield Advice(
            kind="warning",
            text="The plate is interlaced: each frame holds two moments.",
            remedy="Deinterlace it first.",
        )


def _time_advice(findings: Findings) -> Iterator[Advice]:
    summary = findings.summary
    once = {node.name for node in findings.session.graph.nodes if node.once}
    once.add("measure")  # the look at a shot before its first frame
    steady = {name: ms for name, ms in summary.node_median_ms.items() if name not in once}
    if summary.frames < 2 or summary.within_budget >= _MET or not steady:
        return
    node, elapsed_ms = max(steady.items(), key=lambda item: item[1])
    yield Advice(
        kind="note",
        text=f"{summary.within_budget:.0%} of the frames kept the budget of "
        f"{summary.budget_ms:g} ms; {node} costs most ({elapsed_ms:.0f} ms).",
        remedy="Choose a cheaper --preset, or a larger --budget-ms.",
    )


def _note_advice(findings: Findings) -> Iterator[Advice]:
    for note in findings.notes:
        if note == findings.doubt and findings.fit is not None and findings.fit.slope == 0:
            continue
        yield Advice(
            kind="note", text=note[:1].upper() + note[1:] + ".", remedy=_REMEDIES[kind_of(note)]
        )
