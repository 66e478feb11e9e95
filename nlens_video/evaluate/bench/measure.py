"""Runs a rung on its cases in a process of its own: pictures, times, memory, start-up."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import platform
import signal
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
from msgspec import Struct

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import UInt8
from nlens_video.core.version import VERSION
from nlens_video.evaluate.bench.case import Case
from nlens_video.evaluate.bench.methods import Rung, one_frame, opened
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.executor import GraphExecutor
from nlens_video.kernels.thread_pool import processors
from nlens_video.render.select import renderer_choice

_WARM_UP = 2  # frames that load, compile and fill caches
_FEWEST = 3  # frames that are timed, however long they take


class Effort(Struct, frozen=True, kw_only=True):
    """How much is measured.

    Attributes:
        size: columns and rows of the built scenes' frame [px].
        views: points of the lens that their truth is the mean of [1].
        frames: most frames that are timed on a case [1].
        seconds: after which no more are begun, three apart [s].
    """

    size: tuple[int, int]
    views: int
    frames: int
    seconds: float


FULL = Effort(size=(960, 512), views=1024, frames=40, seconds=4.0)
QUICK = Effort(size=(960, 512), views=256, frames=12, seconds=1.5)


Figures = dict[str, float]


def run_apart(rung: Rung, cases: Sequence[Case], effort: Effort) -> dict[str, Figures]:
    """Figures of a rung by case, measured in a process that runs nothing else.

    Raises:
        NlensError: the rung cannot run, or its process was ended.
    """
    fresh = multiprocessing.get_context("spawn")
    deaf = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches it too; the parent ends it
    with ProcessPoolExecutor(1, fresh, signal.signal, deaf) as pool:
        try:
            return pool.submit(_run, rung, cases, effort, time.time()).result()
        except KeyboardInterrupt:
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        except BrokenProcessPool as error:
            raise NlensError(
                f"{rung.name}: its process was ended from outside, perhaps for lack of memory; "
                "free some and run bench again"
            ) from error


def _run(rung: Rung, cases: Sequence[Case], effort: Effort, started: float) -> dict[str, Figures]:
    startup_s = 0.0
    made: list[tuple[Case, UInt8, list[float]]] = []
    for case in cases:
        with opened(rung, case, Profiler(), case.fit) as steps:
            picture = one_frame(steps, case, 0)[0]
            startup_s = startup_s or time.time() - started
            made.append((case, picture, _timed(steps, case, effort)))
    shared = {"startup_s": startup_s, "peak_mib": _peak_mib()}  # before scoring needs memory
    return {case.name: figures(case, picture, ms) | shared for case, picture, ms in made}


def figures(case: Case, picture: UInt8, blur_ms: Sequence[float]) -> Figures:
    """Accuracy of a picture (H, W, 3), median and 95th percentile of the reblur's times [ms]."""
    return case.score(picture) | {
        "median_ms": float(np.median(blur_ms)),
        "p95_ms": float(np.percentile(blur_ms, 95)),
    }


def _timed(steps: GraphExecutor, case: Case, effort: Effort) -> list[float]:
    """What the reblur took on each timed frame [ms]."""
    times: list[float] = []
    blurs = {
        node.name
        for node in steps.graph.nodes
        if node.writes == "blurred"
        or node.name in ("depth-peel", "aperture-views")  # drawn for the blur alone
    }
    end = time.perf_counter() + effort.seconds
    for index in itertools.count(1):
        # another executor: the same one would not blur again what rests
        anew = GraphExecutor(steps.graph, steps.profiler, steps.fit)
        spent = one_frame(anew, case, index)[1]
        if index >= _WARM_UP:
            times.append(sum(ms for name, ms in spent.items() if name in blurs))
        enough = len(times) >= _FEWEST and time.perf_counter() > end
        if enough or len(times) == max(_FEWEST, effort.frames):
            break
    return times


def _peak_mib() -> float:
    """Most memory that this process has held [MiB]; nan where the system does not say."""
    if sys.platform == "linux":  # what `getrusage` says there counts the parent's memory in
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return float("nan")


def machine() -> dict[str, str]:
    """Processor, cores, load, renderer and versions in words; nothing that names the machine."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {
        "processor": _processor(),
        "cores": str(processors()),
        "load at the start": load,
        "renderer": renderer_choice(),
        "system": f"{platform.system()} {platform.machine()}",
        "version": f"nlens-video {VERSION}, Python {platform.python_version()}",
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"
