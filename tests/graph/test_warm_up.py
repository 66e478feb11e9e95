"""Tables and networks made ready before the first frame, on a thread that ends when told to."""

import threading

from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.node_registry import NODES
from nlens_video.graph.nodes.warm_up import WarmUp
from nlens_video.kernels.scatter.disc import tables


class Probe:
    """A node that only warms up."""

    def __init__(self, warm_up):
        self.warm_up = warm_up


def probes(*steps):
    return [Probe(step) for step in steps]


def test_warmup_fills_the_tables_that_the_blur_reads():
    tables.cache_clear()
    context = NodeContext(
        objects=None, estimate_coc=None, ground_y=None, fallback_constant=False, pixel_aspect=1.0
    )
    with WarmUp([NODES["reblur"](context)]) as warmup:
        warmup._thread.join()
    assert tables.cache_info().currsize == 1


def test_warmup_stops_after_the_current_node_and_leaves_no_thread():
    begun, go_on, ran = threading.Event(), threading.Event(), []

    def slow():
        begun.set()
        go_on.wait(10.0)
        ran.append("slow")

    before = threading.active_count()
    with WarmUp(probes(slow, lambda: ran.append("late"))) as warmup:
        assert begun.wait(10.0)
        warmup._stop.set()
        go_on.set()
    assert ran == ["slow"] and threading.active_count() <= before


def test_warmup_ignores_errors_of_nodes():
    ran = []

    def broken():
        ran.append("broken")
        raise ValueError("no such network")

    with WarmUp(probes(broken)) as warmup:
        warmup._thread.join()
    assert ran == ["broken"]
