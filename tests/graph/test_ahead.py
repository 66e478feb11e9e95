"""Kernels made ready before the first frame needs them, on a thread that ends when told to."""

import subprocess
import sys
import threading
from dataclasses import replace

import pytest

from nlens_video.graph.builder import Graph
from nlens_video.graph.node import Node
from nlens_video.graph.warmup import Ahead
from nlens_video.render.software import deferred, raster, triangles

PROBE = """
import sys
sys.path.insert(0, {tests!r})
from graph.test_ahead import graph, node
from nlens_video.core.aperture import ROUND
from nlens_video.graph.warmup import Ahead
from nlens_video.kernels import blend, scatter, scatter_rows
with Ahead(graph(node("reblur", "scatter"), node("composite", "composite"))) as ahead:
    ahead._thread.join()
assert len(scatter_rows.scatter_rows.signatures) == 1, scatter_rows.scatter_rows.signatures
assert blend._compiled.cache_info().currsize == 2, blend._compiled.cache_info()
print("ready")
"""


def node(name, stage, run=lambda *given: None):
    return Node(
        name=name, stage=stage, inputs=(), optional=(), output="blurred", cadence="frame",
        lane="lens", effect=None, when=None, without=None, backend="", run=run,
    )  # fmt: skip


def graph(*nodes):
    return Graph(pipeline="p", summary="", nodes=nodes, left_out=())


def test_kernels_are_ready_for_the_nodes_that_need_them(request):
    # in a process of its own: here other tests have compiled them long since
    script = PROBE.format(tests=str(request.path.parents[1]))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "ready", done.stderr


def test_the_software_rasteriser_is_ready_where_it_draws():
    drawn = replace(node("render", "render"), backend="software rasteriser (no graphics device)")
    with Ahead(graph(drawn)) as ahead:
        ahead._thread.join()
    assert deferred.shade_rows.signatures and raster.fill.signatures and triangles.set_up.signatures


def test_a_node_runs_ahead_with_inputs_of_its_own_kind():
    seen = []
    with Ahead(graph(node("repair", "repair", lambda *given: seen.append(given)))) as ahead:
        ahead._thread.join()
    ((defocused, blurred),) = seen
    assert defocused.largest_step_px > 1.0 and blurred.box == defocused.layer.box


def test_it_ends_after_the_work_at_hand_and_leaves_no_thread():
    begun, go_on, ran = threading.Event(), threading.Event(), []

    def slow(*given):
        begun.set()
        go_on.wait(10.0)
        ran.append("slow")

    late = node("late", "repair", lambda *given: ran.append("late"))
    before = threading.active_count()
    with Ahead(graph(node("slow", "repair", slow), late)) as ahead:
        assert begun.wait(10.0)
        ahead._stop.set()
        go_on.set()
    assert ran == ["slow"] and threading.active_count() == before


def test_what_goes_wrong_is_left_to_the_frame_that_needs_it():
    def broken(*given):
        raise ValueError("no such network")

    with Ahead(graph(node("repair", "repair", broken))) as ahead:
        ahead._thread.join()
    assert ahead.notes == ()


@pytest.mark.parametrize(("seconds", "lines"), [(0.4, 0), (12.3, 1)])
def test_only_a_wait_that_is_noticed_is_told_of(seconds, lines):
    ahead = Ahead(graph())
    ahead._seconds = seconds
    assert len(ahead.notes) == lines
