"""The report's page: header with warnings, wipe between plate and composite, strip of frames."""

from __future__ import annotations

from html import escape

import numpy as np

from nlens_video.report.camera import ground_section
from nlens_video.report.findings import NEVER_SEEN, Findings
from nlens_video.report.fit import fit_section, unit_name
from nlens_video.report.html import (
    Image,
    count,
    document,
    embedded_jpeg,
    figure,
    file_name,
    missing,
    picture,
    prose,
    section,
)
from nlens_video.report.maps import maps_section
from nlens_video.report.prose import advice, lens_sentences
from nlens_video.report.times import plan_section, times_section

_LENGTHS = {
    "m": "Lengths are in metres (m), the unit of glTF.",
    "units": "Lengths are in units of the GLB.",
}


def page(findings: Findings) -> str:
    """The page as text; everything that came from outside is escaped."""
    arrow = "\N{RIGHTWARDS ARROW}"
    sections = (
        _compare, _strip, ground_section, maps_section, fit_section, times_section, plan_section,
    )  # fmt: skip
    return document(
        "report",
        f"{file_name(findings.info.name)} {arrow} {file_name(findings.output)}",
        lens_sentences(findings),
        "\n".join(part(findings) for part in sections),
        header=_facts(findings) + _advice(findings),
        footer=f"{_LENGTHS[unit_name(findings.session.context.unit_m)]} CoC is the diameter of the "
        "circle of confusion in pixels of the frame.",
    )


def _facts(findings: Findings) -> str:
    info, summary = findings.info, findings.summary
    rate = f"{float(info.average_rate):.4g} fps" if info.average_rate else "unknown rate"
    if info.kind == "still":
        rate = "still"
    only_lens = findings.main is not None and findings.main.after is None
    facts = [
        ("Plate", file_name(info.name), f"{info.codec}, {info.pixel_format}"),
        ("Object", findings.session.context.objects.scene.path.name, ""),
        (
            "Written",
            file_name(findings.output),
            "the lens" if only_lens else count(summary.frames, "frame"),
        ),
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
    return f'<dl class="facts">{rows}</dl>'


def _advice(findings: Findings) -> str:
    items = "".join(
        f'<li class="{one.kind}"><strong>{one.kind.capitalize()}</strong>{prose(one.text)}'
        f"{f'<span>What to do: {prose(one.remedy)}</span>' if one.remedy else ''}</li>"
        for one in advice(findings)
    )
    return f'<ul class="advice" aria-label="Warnings and notes">{items}</ul>' if items else ""


def _compare(findings: Findings) -> str:
    main, title = findings.main, "Before and after"
    if main is None:
        return section("compare", title, missing(findings.no_fit_reason or NEVER_SEEN))
    place = f"frame {main.index}, {main.time_s:.2f} s"
    plate = picture(main.before, f"The plate, {place}")
    if main.after is None:
        words = f"{place.capitalize()}. No frame was composited in this run."
        return section("compare", "The plate", figure(plate, words))
    first = "Shown" if findings.shot.plate_coc is None else "Lens measured and result shown"
    return section(
        "compare",
        title,
        f'<p class="quiet">{first} on {place}, the first with the object in view.</p>'
        '<div class="compare"><div class="stack">'
        f"{picture(main.after, f'The composite, {place}')}"
        f'<div class="before">{plate}</div>'
        '<span class="edge"></span><span class="tag left">plate</span>'
        '<span class="tag right">composite</span></div>'
        '<label for="split">Wipe between plate and composite (arrow keys move the edge)</label>'
        '<input id="split" type="range" min="0" max="100" '
        f'value="{_wipe_percent(main.before, main.after)}"></div>',
    )


def _wipe_percent(before: Image, after: Image) -> int:
    """First position of the wipe, across the object, so that each side shows some of it [%]."""
    changed = np.abs(after.astype(np.int16) - before).sum(axis=(0, 2)).astype(np.float64)
    if not changed.any():
        return 50
    middle = float(np.average(np.arange(len(changed)) + 0.5, weights=changed)) / len(changed)
    return round(100 * min(max(middle, 0.05), 0.95))


def _strip(findings: Findings) -> str:
    if len(findings.strip) < 2:
        return ""
    figures = ""
    for frame in findings.strip:
        coc = "sharp" if frame.largest_coc_px is None else f"CoC to {frame.largest_coc_px:.1f} px"
        thumbnail = embedded_jpeg(frame.jpeg, frame.size, f"Composite, frame {frame.index}")
        figures += (
            f"<figure>{thumbnail}<figcaption><b>{frame.index}</b> at {frame.time_s:.2f} s<br>{coc}"
            "</figcaption></figure>"
        )
    words = "Composited frames, evenly spaced over the clip."
    return section(
        "strip", "Over the clip", f'<p class="quiet">{words}</p><div class="strip">{figures}</div>'
    )
