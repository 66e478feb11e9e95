"""What each node cost over the clip, stacked, with the budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.report.findings import Findings
from nlens_video.report.svg import Axes, line, path, text

NODE_COLORS = 7  # classes `node-0` ... of the style sheet; the last one is `node-rest`
REST = "other nodes"
_WIDTH, _HEIGHT = 900.0, 320.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingPlot:
    """The chart and its key.

    Attributes:
        svg: the drawing.
        key: class and name of each layer, from the bottom up.
    """

    svg: str
    key: tuple[tuple[str, str], ...]


def timing_plot(findings: Findings) -> TimingPlot | None:
    """The stacked chart; None where no frame but the one that carried the fit was timed."""
    layers = _layers(findings)
    if not layers:
        return None
    tops = np.cumsum([row for _, _, row in layers], axis=0)
    edges = np.array([bin_.first for bin_ in findings.bins] + [_end(findings)], np.float64)
    budget = findings.summary.budget_ms
    high = max(1.12 * budget, 1.25 * float(np.quantile(tops[-1], 0.95)))
    axes = Axes(width=_WIDTH, height=_HEIGHT, x=(float(edges[0]), float(edges[-1])), y=(0.0, high))
    parts = [axes.frame("frame", "time (ms)")]
    below = np.zeros(len(findings.bins))
    for (kind, _, _), above in zip(layers, tops, strict=True):
        parts.append(_steps(axes, edges, np.minimum(below, high), np.minimum(above, high), kind))
        below = above
    key = [(kind, name) for kind, name, _ in layers]
    if findings.bin_width > 1:
        slowest = np.array([bin_.slowest_ms for bin_ in findings.bins])
        middles = 0.5 * (edges[:-1] + edges[1:])
        parts.append(path(axes.points(middles, np.minimum(slowest, high)), "slowest"))
        key.append(("slowest", "slowest frame of each mean"))
    parts.append(_cut_off(axes, edges, tops[-1]))
    y = float(axes.place_y(np.array(budget)))
    parts.append(line((axes.left, y), (axes.right, y), "budget"))
    parts.append(text((axes.right - 4, y - 6), f"budget {budget:g} ms", "label", "end"))
    svg = axes.drawing(
        "Time of each node over the clip",
        f"Median {findings.summary.median_ms:.1f} ms a frame, budget {budget:g} ms.",
        "".join(parts),
    )
    return TimingPlot(svg=svg, key=tuple(key))


def _layers(findings: Findings) -> list[tuple[str, str, Float64]]:
    """Class, name and mean time per bin [ms] of the costliest nodes, in the order they run."""
    order = list(dict.fromkeys(node for bin_ in findings.bins for node in bin_.total_ms))
    rows = {node: np.array([bin_.mean_ms(node) for bin_ in findings.bins]) for node in order}
    costly = sorted(order, key=lambda node: -float(rows[node].sum()))[:NODE_COLORS]
    named = [node for node in order if node in costly]
    layers = [(f"node-{at}", node, rows[node]) for at, node in enumerate(named)]
    rest = [rows[node] for node in order if node not in costly]
    if rest:
        layers.append(("node-rest", REST, np.sum(rest, axis=0)))
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
    x = float(axes.place_x(np.array(0.5 * (edges[worst] + edges[worst + 1]))))
    near_right = x > 0.5 * (axes.left + axes.right)
    words = f"{totals[worst]:,.0f} ms"
    place = (x, axes.top - 6)
    return text(place, words, "label", "end" if near_right else "start")


def _end(findings: Findings) -> int:
    return findings.bins[-1].first + max(findings.bins[-1].frames, 1)
