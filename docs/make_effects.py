"""Make docs/effects.md: which effects are found on shots that are known to have them.

python docs/make_effects.py
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from support.effects.sensor_rows import SENSOR_ROWS  # noqa: E402
from support.effects.shot_table import ROWS, UNITS, UNSEEN, Verdict, judge  # noqa: E402

INTRODUCTION = """\
# Which effects a shot calls for

Shots of known scenes, taken by a simulated camera with known effects and, except a few, encoded
by H.264; the measurements of a run decide (`python docs/make_effects.py` makes this page
from `tests/support/effects/shot_table.py`). The strength is that of the simulation; in
brackets the true one. Effects in *italics* are present, but hardly visible (compression
removes faint fringes, the shading of a scene hides vignetting, short lines show no distortion):
not detecting them is correct, and `--vignetting` or `--distortion` set them. Thresholds were
chosen on the first rows; rows called *unseen* are on scenes that were made afterwards.
"""


def line(verdicts: list[Verdict]) -> str:
    """A shot's row."""
    cells = []
    for one in verdicts:
        if one.true is None and not one.wanted:
            continue
        unit = UNITS.get(one.effect, "")
        found = f"{one.found:.2f}" if one.wanted else "not called for"
        true = "not there" if one.true is None else f"{one.true:.2f} {unit}"
        name = f"*{one.effect}*" if one.effect in one.row.weak else one.effect
        cells.append(f"{name} {found} ({true})")
    right = "yes" if all(one.right for one in verdicts) else "**no**"
    return f"| {verdicts[0].row.name} | {'; '.join(cells) or 'none'} | {right} |"


def summary(verdicts: list[Verdict]) -> str:
    """The figures under the table."""
    clean = [one for one in verdicts if not one.row.truth]
    errors = [abs(one.error) for one in verdicts if one.error is not None]
    rows = len({one.row.name for one in verdicts})
    return (
        f"{rows} shots, {len(verdicts)} decisions: {sum(one.right for one in verdicts)} right; on "
        f"clean plates {sum(one.wanted for one in clean)} of {len(clean)} called for. Strength, "
        f"where called for: {sum(error <= 0.15 for error in errors)} of {len(errors)} within 15 %, "
        f"the worst off by {100 * max(errors):.0f} %."
    )


def main() -> None:
    """Judge every row and write the page."""
    lines, every = [], []
    for row in [*ROWS, *SENSOR_ROWS]:
        verdicts = judge(row)
        every += verdicts
        lines.append(line(verdicts))
        print(lines[-1], flush=True)
    head = "| shot | found (true) | decisions right |\n| --- | --- | --- |"
    unseen = [one for one in every if one.row in UNSEEN]
    figures = [summary(every), "", f"Of these, unseen: {summary(unseen)}"]
    page = "\n".join([INTRODUCTION, head, *lines, "", *figures, ""])
    (ROOT / "docs" / "effects.md").write_text(page)
    print(summary(every))


if __name__ == "__main__":
    main()
