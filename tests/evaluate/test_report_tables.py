"""Tables of the evaluation reports."""

import math

import pytest

from nlens_video.evaluate.report import Column, Table


def table(**values):
    made = Table(
        name="errors", title="Errors",
        columns=(Column("px", "error", 1, "median"), Column("px", "90th", 1, "p90")), **values,
    )  # fmt: skip
    for number in range(11):
        made.add("ours", f"plate{number}", {"px": float(number)})
    made.add("ours", "unknown", {"px": math.nan})
    return made


def test_median_and_90th_percentile_leave_out_what_is_not_known():
    assert table().summary() == [{"name": "ours", "px": 5.0, "px_p90": pytest.approx(9.0)}]


def test_figures_are_shown_plate_by_plate_only_where_asked_for():
    assert "plate3" not in table().markdown()
    assert "error, plate by plate:" in table(detail="px").markdown()
    assert "plate3" in table(detail="px").markdown()
