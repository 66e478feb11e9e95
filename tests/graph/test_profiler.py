import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.graph.base.profiler import Profiler, Quantiles


@given(st.lists(st.floats(0.01, 5000), min_size=1, max_size=200), st.floats(0.01, 1.0))
def test_running_quantiles_are_exact_to_one_percent(values, share):
    quantiles = Quantiles()
    for value in values:
        quantiles.add(value)
    exact = float(np.quantile(values, share, method="inverted_cdf"))
    assert quantiles.quantile(share) == pytest.approx(exact, rel=0.011)


def test_profiler_reports_a_row_per_frame_with_the_nodes_that_ran():
    rows = []
    profiler = Profiler(budget_ms=50, on_frame=rows.append)
    for index in range(3):
        with profiler.timed(index, "render"):
            time.sleep(0.002)
        if index:
            profiler.add(index, "reblur", 3.0)
        profiler.close_frame(index, pts=index * 40)
    assert [(row.index, row.pts, sorted(row.nodes)) for row in rows] == [
        (0, 0, ["render"]),
        (1, 40, ["reblur", "render"]),
        (2, 80, ["reblur", "render"]),
    ]
    assert rows[1].total_ms == pytest.approx(sum(rows[1].nodes.values()))
    assert rows[0].nodes["render"] >= 2.0


def test_first_frame_with_the_fit_is_reported_separately():
    profiler = Profiler(budget_ms=10)
    profiler.add(0, "estimate-coc", 500.0)
    profiler.close_frame(0, pts=0, warm_up=True)
    for index in range(1, 5):
        profiler.add(index, "render", 8.0 if index < 4 else 20.0)
        profiler.close_frame(index, pts=index)
    summary = profiler.summary()
    assert summary.first_frame_ms == pytest.approx(500.0)
    assert summary.median_ms == pytest.approx(8.0, rel=0.01)
    assert summary.within_budget == 0.75
    assert summary.frames == 5
    assert summary.node_median_ms["estimate-coc"] == pytest.approx(500.0)


def test_profiler_memory_does_not_grow_with_the_number_of_frames():
    profiler = Profiler()
    for index in range(5000):
        profiler.add(index, "render", 1.0 + index % 50)
        profiler.close_frame(index, pts=index)
    assert not profiler._open
    assert len(profiler._nodes["render"]._bins) < 500
