"""The parts of the page about the run: times and plan."""

from __future__ import annotations

from html import escape

from nlens_video.graph.session import plan_rows
from nlens_video.report.findings import Findings
from nlens_video.report.markup import key, missing, section, table
from nlens_video.report.timing_plot import timing_plot


def times_part(findings: Findings) -> str:
    """What each node cost, frame by frame and as medians."""
    plot = timing_plot(findings)
    body = ""
    if plot is not None:
        each = "each frame" if findings.bin_width == 1 else f"means of {findings.bin_width} frames"
        words = f"Time of the nodes, {each}, stacked. Neighbouring frames overlap, so a frame is "
        words += "written sooner than its sum says."
        if findings.warm_up is not None:
            words += (
                f" Frame {findings.warm_up.index}, on which the lens was measured, is not drawn: "
                f"it took {findings.warm_up.total_ms:,.0f} ms."
            )
        body = (
            f'<p class="quiet">{words}</p>{key(list(plot.key))}<div class="scroll" tabindex="0" '
            f'role="region" aria-label="Chart of the times">{plot.svg}</div>'
        )
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


def plan_part(findings: Findings) -> str:
    """What ran, on what, and why."""
    rows = "".join(
        f"<dt>{escape(row.subject)}</dt>"
        f"<dd>{escape(f'{row.when}: {row.text}' if row.when else row.text)}</dd>"
        for row in plan_rows(findings.session)
    )
    return section("plan", "The plan", f'<dl class="plan">{rows}</dl>')
