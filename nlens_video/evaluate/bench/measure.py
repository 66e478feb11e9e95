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
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import UInt8
from nlens_video.core.version import VERSION
from nlens_video.evaluate.bench.case import Case
from nlens_video.evaluate.bench.methods import Rung, one_frame, opened
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.executor import GraphExecutor
from nlens_video.render.select import renderer_choice

_WARM_UP = 2  # frames that load, compile and fill caches
_FEWEST = 3  # frames that are timed, however long they take


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class OneCase:
    """What a rung made of a case.

    Attributes:
        picture: display-coded RGB (H, W, 3).
        blur_ms: what the reblur took on each timed frame [ms].
    """

    picture: UInt8
    blur_ms: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RungRun:
    """What a rung made of all its cases, in the process that ran nothing else.

    Attributes:
        cases: by name.
        startup_s: from the start of the process to its first frame, loading included [s].
        peak_mib: most memory that the process held, nan where the system does not say [MiB].
    """

    cases: dict[str, OneCase]
    startup_s: float
    peak_mib: float

    def figures(self, case: Case) -> dict[str, float]:
        """All figures of one case, by name."""
        one = self.cases[case.name]
        return case.score(one.picture) | {
            "median_ms": float(np.median(one.blur_ms)),
            "p95_ms": float(np.percentile(one.blur_ms, 95)),
            "startup_s": self.startup_s,
            "peak_mib": self.peak_mib,
        }


def run_apart(rung: Rung, cases: Sequence[Case], effort: Effort) -> RungRun:
    """Run a rung in a process of its own.

    Raises:
        NlensError: the rung cannot run, or its process was ended.
    """
    fresh = multiprocessing.get_context("spawn")
    deaf = (signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches it too; the parent ends it
    with ProcessPoolExecutor(1, fresh, signal.signal, deaf) as pool:
        try:
            return pool.submit(run_rung, rung, cases, effort, time.time()).result()
        except KeyboardInterrupt:
            for child in multiprocessing.active_children():
                child.terminate()
            raise
        except BrokenProcessPool as error:
            raise NlensError(
                f"{rung.name}: its process was ended from outside, perhaps for lack of memory; "
                "free some and run bench again"
            ) from error


def run_rung(rung: Rung, cases: Sequence[Case], effort: Effort, started: float) -> RungRun:
    """Run a rung here.

    Args:
        rung: what runs.
        cases: on what.
        effort: how often.
        started: when its process was asked for, as `time.time()` [s].
    """
    startup = 0.0
    made: dict[str, OneCase] = {}
    for case in cases:
        profiler = Profiler()
        with opened(rung, case, profiler, case.fit) as steps:
            picture = one_frame(steps, case, 0)[0]
            startup = startup or time.time() - started
            made[case.name] = OneCase(picture=picture, blur_ms=_timed(steps, case, effort))
    return RungRun(cases=made, startup_s=startup, peak_mib=_peak_mib())


def _timed(steps: GraphExecutor, case: Case, effort: Effort) -> tuple[float, ...]:
    times: list[float] = []
    blurs = {
        node.name
        for node in steps.graph.nodes
        if node.writes == "blurred"
        or node.name in ("depth-peel", "aperture-views")  # drawn for the blur alone
    }
    end = time.perf_counter() + effort.seconds
    for index in itertools.count(1):
        spent = one_frame(steps, case, index)[1]
        if index >= _WARM_UP:
            times.append(sum(ms for name, ms in spent.items() if name in blurs))
        enough = len(times) >= _FEWEST and time.perf_counter() > end
        if enough or len(times) == max(_FEWEST, effort.frames):
            break
    return tuple(times)


def _peak_mib() -> float:
    """Most memory that this process has held [MiB]; nan where the system does not say."""
    if sys.platform == "linux":  # what `getrusage` says there counts the parent's memory in
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return float("nan")


def machine() -> dict[str, str]:
    """Processor, cores, load, renderer and versions in words; nothing that names the machine."""
    affinity = getattr(os, "sched_getaffinity", None)
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    return {
        "processor": _processor(),
        "cores": str(len(affinity(0)) if affinity else os.cpu_count() or 1),
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
