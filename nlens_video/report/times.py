"""Sections "Time" and "Plan": time of each node over the clip, and what ran on what."""

from __future__ import annotations

from html import escape

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.graph.session import plan_rows
from nlens_video.report.findings import Findings, TimingBin
from nlens_video.report.html import key, missing, scrolled, section, table
from nlens_video.report.svg import Axes, line, path, text

_NODE_COLORS = 7  # classes `node-0` ... of the style sheet; the last one is `node-rest`
_WIDTH, _HEIGHT = 900.0, 320.0


def times_section(findings: Findings) -> str:
    """Time of each node, frame by frame and as medians."""
    body = ""
    layers = _layers(findings.timings.bins)
    if layers:
        width = findings.timings.width
        each = "on each frame" if width == 1 else f"as means of {width} frames"
        words = f"Time of each node {each}, stacked. Frames overlap, so they are written faster "
        words += "than the sums say."
        if findings.warm_up is not None:
            words += (
                f" Frame {findings.warm_up.index}, on which the lens was measured, is not drawn: "
                f"it took {findings.warm_up.total_ms:,.0f} ms."
            )
        entries = [(kind, name) for kind, name, _ in layers]
        if width > 1:
            entries.append(("slowest", "slowest frame of each mean"))
        chart = scrolled(_chart(findings, layers), "Chart of the times")
        body = f'<p class="quiet">{words}</p>{key(entries)}{chart}'
    rows = _node_rows(findings)
    if rows:
        head = ("node", "median (ms)", "how often", "runs on")
        body += table("Median time of each node where it ran", head, rows, number_column=1)
    return section("times", "Time", body or missing("No frame was timed."))


def _node_rows(findings: Findings) -> list[tuple[str, ...]]:
    """Name, median, cadence and backend of each node that ran, in the order they run."""
    medians = findings.summary.node_median_ms
    nodes = findings.session.graph.nodes
    known = [
        ("decode", "each frame", "FFmpeg"),
        *(
            (node.name, "once a shot" if node.once else "each frame", node.description)
            for node in nodes
        ),
        ("encode", "each frame", "FFmpeg"),
    ]
    return [(name, f"{medians[name]:.1f}", *rest) for name, *rest in known if name in medians]


def plan_section(findings: Findings) -> str:
    """The plan as `--plan` prints it: what ran, on what, and why."""
    rows = "".join(
        f"<dt>{escape(row.subject)}</dt>"
        f"<dd>{escape(f'{row.when}: {row.text}' if row.when else row.text)}</dd>"
        for row in plan_rows(findings.session)
    )
    return section("plan", "Plan", f'<dl class="plan">{rows}</dl>')


def _chart(findings: Findings, layers: list[tuple[str, str, Float64]]) -> str:
    """SVG of the stacked times, with the budget."""
    bins, budget = findings.timings.bins, findings.summary.budget_ms
    tops = np.cumsum([row for _, _, row in layers], axis=0)
    end = bins[-1].first + max(bins[-1].frames, 1)
    edges = np.array([bin_.first for bin_ in bins] + [end], np.float64)
    high = max(1.12 * budget, 1.25 * float(np.quantile(tops[-1], 0.95)))
    axes = Axes(width=_WIDTH, height=_HEIGHT, x=(float(edges[0]), float(edges[-1])), y=(0.0, high))
    parts = [axes.frame("frame", "time (ms)")]
    below = np.zeros(len(bins))
    for (kind, _, _), above in zip(layers, tops, strict=True):
        parts.append(_steps(axes, edges, np.minimum(below, high), np.minimum(above, high), kind))
        below = above
    if findings.timings.width > 1:
        slowest = np.array([bin_.slowest_ms for bin_ in bins])
        middles = 0.5 * (edges[:-1] + edges[1:])
        parts.append(path(axes.points(middles, np.minimum(slowest, high)), "slowest"))
    parts.append(_cut_off(axes, edges, tops[-1]))
    y = axes.place_y(budget)
    parts.append(line((axes.left, y), (axes.right, y), "budget"))
    parts.append(text((axes.right - 4, y - 6), f"budget {budget:g} ms", "label", "end"))
    return axes.drawing(
        "Time of each node over the clip",
        f"Median {findings.summary.median_ms:.1f} ms a frame, budget {budget:g} ms.",
        "".join(parts),
    )


def _layers(bins: list[TimingBin]) -> list[tuple[str, str, Float64]]:
    """Class, name and mean time per bin [ms] of the slowest nodes, in the order they run."""
    order = list(dict.fromkeys(node for bin_ in bins for node in bin_.total_ms))
    rows = {node: np.array([bin_.mean_ms(node) for bin_ in bins]) for node in order}
    costly = sorted(order, key=lambda node: -float(rows[node].sum()))[:_NODE_COLORS]
    named = [node for node in order if node in costly]
    layers = [(f"node-{at}", node, rows[node]) for at, node in enumerate(named)]
    rest = [rows[node] for node in order if node not in costly]
    if rest:
        layers.append(("node-rest", "other nodes", np.sum(rest, axis=0)))
    return layers


def _steps(axes: Axes, edges: Float64, low: Float64, high: Float64, kind: str) -> str:
    x = np.repeat(edges, 2)[1:-1]
    outline = axes.points(x, np.repeat(high, 2))
    return path(outline + axes.points(x, np.repeat(low, 2))[::-1], kind, closed=True)


def _cut_off(axes: Axes, edges: Float64, totals: Float64) -> str:
    """The time of the tallest bar, where the chart ends below it: a few outliers hide the rest."""
    worst = int(np.argmax(totals))
    if totals[worst] <= axes.y[1]:
        return ""
    x = axes.place_x(0.5 * float(edges[worst] + edges[worst + 1]))
    near_right = x > 0.5 * (axes.left + axes.right)
    words = f"{totals[worst]:,.0f} ms"
    place = (x, axes.top - 6)
    return text(place, words, "label", "end" if near_right else "start")
