"""Kernels compiled before the first frame needs them, on a thread that ends when told to."""

import subprocess
import sys
import threading

import pytest

from nlens_video.graph.nodes.warm_up import KernelWarmup

PROBE = """
from nlens_video.core.optics import ROUND
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.nodes.warm_up import KernelWarmup
from nlens_video.graph.pipeline_file import NODES
from nlens_video.kernels.scatter import scatter_rows
from nlens_video.render.software import deferred, raster, triangles
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.video.pixels import blend

class Objects:
    description = "software rasteriser"
    def warm_up(self):
        SoftwareObjectRenderer.warm_up(None)

context = NodeContext(
    objects=Objects(), estimate_coc=None, ground_y=None, fallback_constant=False, pixel_aspect=1.0
)
nodes = tuple(NODES[name](context) for name in ("render", "reblur", "composite"))
warmup = KernelWarmup(nodes)
with warmup:
    warmup._thread.join()
assert len(scatter_rows.scatter_rows.signatures) == 1, scatter_rows.scatter_rows.signatures
assert blend._compiled.cache_info().currsize == 2, blend._compiled.cache_info()
assert deferred.shade_rows.signatures and raster.fill.signatures and triangles.set_up.signatures
print("ready")
"""


class Probe:
    """A node that only warms up."""

    def __init__(self, warm_up):
        self.warm_up = warm_up


def probes(*steps):
    return [Probe(step) for step in steps]


@pytest.mark.slow
def test_warmup_compiles_the_kernels_of_the_graphs_nodes():
    # in a process of its own: here other tests have compiled them long since
    done = subprocess.run(
        [sys.executable, "-c", PROBE], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "ready", done.stderr


def test_warmup_stops_after_the_current_node_and_leaves_no_thread():
    begun, go_on, ran = threading.Event(), threading.Event(), []

    def slow():
        begun.set()
        go_on.wait(10.0)
        ran.append("slow")

    before = threading.active_count()
    with KernelWarmup(probes(slow, lambda: ran.append("late"))) as warmup:
        assert begun.wait(10.0)
        warmup._stop.set()
        go_on.set()
    assert ran == ["slow"] and threading.active_count() <= before


def test_warmup_ignores_errors_of_nodes():
    def broken():
        raise ValueError("no such network")

    with KernelWarmup(probes(broken)) as warmup:
        warmup._thread.join()
    assert warmup.notes == ()


@pytest.mark.parametrize(("seconds", "lines"), [(0.4, 0), (12.3, 1)])
def test_warmup_is_noted_only_if_it_took_noticeable_time(seconds, lines):
    warmup = KernelWarmup(probes())
    warmup._seconds = seconds
    assert len(warmup.notes) == lines
