"""The page: one HTML file with everything in it, for any screen, for eyes and ears."""

from __future__ import annotations

from html import escape
from importlib.resources import files
from pathlib import PurePath
from string import Template

import numpy as np

from nlens_video.core.version import VERSION
from nlens_video.report.findings import Findings, StripFrame
from nlens_video.report.lens_part import fit_part, maps_part
from nlens_video.report.markup import count, figure, image, jpeg_image, missing, prose, section
from nlens_video.report.pictures import Image
from nlens_video.report.prose import NEVER_SEEN, advice, lens_sentences, no_fit_reason
from nlens_video.report.run_part import plan_part, times_part


def page(findings: Findings) -> str:
    """The page as text; everything that came from outside is escaped."""
    folder = files("nlens_video.report")
    template = Template(folder.joinpath("page.html").read_text(encoding="utf-8"))
    parts = (_compare, _strip, maps_part, fit_part, times_part, plan_part)
    return template.substitute(
        title=escape(_title(findings)),
        style=folder.joinpath("page.css").read_text(encoding="utf-8"),
        header=_header(findings),
        sections="\n".join(part(findings) for part in parts),
        footer=f"Made by nlens-video {escape(VERSION)}. Lengths are in the unit of the GLB, "
        "which glTF takes for metres (m). Blur is the diameter of the circle of confusion (CoC) "
        "in pixels of the frame.",
    )


def _title(findings: Findings) -> str:
    return f"{_name(findings.info.name)} \N{RIGHTWARDS ARROW} {_name(findings.output)}"


def _name(spec: str) -> str:
    """Last part of a path; addresses and `-` as they are."""
    return spec if "://" in spec or spec == "-" else PurePath(spec).name or spec


def _header(findings: Findings) -> str:
    info, summary = findings.info, findings.summary
    rate = f"{float(info.average_rate):.4g} fps" if info.average_rate else "unknown rate"
    if info.kind == "still":
        rate = "still"
    facts = [
        ("Plate", _name(info.name), f"{info.codec}, {info.pixel_format}"),
        ("Object", findings.session.context.objects.scene.path.name, ""),
        ("Written", _name(findings.output), _written(findings)),
        ("Frame", f"{info.width} \N{MULTIPLICATION SIGN} {info.height} px", rate),
        ("Pipeline", findings.session.graph.pipeline, findings.session.graph.summary),
    ]
    if summary.frames > 1:
        within = f"{summary.within_budget:.0%} within {summary.budget_ms:g} ms"
        facts.append(("Time a frame", f"{summary.median_ms:.0f} ms", f"median; {within}"))
    rows = "".join(
        f"<div><dt>{escape(name)}</dt><dd>{escape(value)}"
        f"{f'<small>{escape(more)}</small>' if more else ''}</dd></div>"
        for name, value, more in facts
    )
    items = "".join(
        f'<li class="{one.kind}"><strong>{one.kind.capitalize()}</strong>{prose(one.text)}'
        f"{f'<span>What to do: {prose(one.remedy)}</span>' if one.remedy else ''}</li>"
        for one in advice(findings)
    )
    return (
        '<p class="eyebrow">nlens-video report</p>'
        f"<h1>{escape(_title(findings))}</h1>"
        f'<p class="lead">{prose(lens_sentences(findings))}</p>'
        f'<dl class="facts">{rows}</dl>'
        + (f'<ul class="advice" aria-label="What to know">{items}</ul>' if items else "")
    )


def _written(findings: Findings) -> str:
    """How much was written; a run that only finds the lens writes no frames."""
    only_lens = findings.shown is not None and findings.shown.after is None
    return "the lens" if only_lens else count(findings.summary.frames, "frame")


def _compare(findings: Findings) -> str:
    shown = findings.shown
    if shown is None:
        return section(
            "compare", "Before and after", missing(no_fit_reason(findings) or NEVER_SEEN)
        )
    place = f"frame {shown.index}, {shown.time_s:.2f} s"
    if shown.after is None:
        return section(
            "compare",
            "The plate",
            figure(image(shown.before, f"The plate, {place}"), f"{place.capitalize()}. No frame "
                    "was composited in this run."),
        )  # fmt: skip
    first = f"Measured and shown on {place}" if _carried(findings) else f"Shown: {place}"
    return section(
        "compare",
        "Before and after",
        f'<p class="quiet">{first}, the first with the object in view.</p>'
        '<div class="compare"><div class="stack">'
        f"{image(shown.after, f'The composite, {place}')}"
        f'<div class="before">{image(shown.before, f"The plate, {place}")}</div>'
        '<span class="edge"></span><span class="tag left">plate</span>'
        '<span class="tag right">composite</span></div>'
        '<label for="split">Share of the plate that is shown (arrow keys move the edge)</label>'
        '<input id="split" type="range" min="0" max="100" '
        f'value="{_split(shown.before, shown.after)}"></div>',
    )


def _split(before: Image, after: Image) -> int:
    """Where the edge stands at first: across the object, so that both sides show some of it [%]."""
    changed = np.abs(after.astype(np.int16) - before).sum(axis=(0, 2)).astype(np.float64)
    if not changed.any():
        return 50
    middle = float(np.average(np.arange(len(changed)) + 0.5, weights=changed)) / len(changed)
    return round(100 * min(max(middle, 0.05), 0.95))


def _carried(findings: Findings) -> bool:
    return findings.shot.plate_coc is not None


def _strip(findings: Findings) -> str:
    if len(findings.strip) < 2:
        return ""
    figures = "".join(_strip_figure(frame) for frame in findings.strip)
    words = "Composited frames, spread evenly over the clip."
    return section(
        "strip", "Over the clip", f'<p class="quiet">{words}</p><div class="strip">{figures}</div>'
    )


def _strip_figure(frame: StripFrame) -> str:
    blur = "sharp" if frame.largest_coc_px is None else f"blur to {frame.largest_coc_px:.1f} px"
    picture = jpeg_image(frame.jpeg, frame.size, f"Composite, frame {frame.index}")
    return (
        f"<figure>{picture}<figcaption><b>{frame.index}</b> at {frame.time_s:.2f} s<br>{blur}"
        "</figcaption></figure>"
    )
