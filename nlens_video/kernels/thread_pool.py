"""Parallel loops over threads that release the interpreter's lock."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TypeVar

from nlens_video.kernels.control_groups import MOUNTED, processor_quota

T = TypeVar("T")
R = TypeVar("R")
Band = tuple[int, int]
"""First row, and the one past the last."""

_BAND_PX = 32768  # of a picture, for a thread
_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_thread = threading.local()
_at_work = 0  # threads inside `parallel_for`, helpers included


def processors(group: Path = MOUNTED) -> int:
    """Processors this process may use; fewer than the machine's in a container or by taskset.

    Args:
        group: folder of the container's control group.
    """
    quota = processor_quota(group)
    return _bound() if quota is None else min(_bound(), quota)


def _bound() -> int:
    """Processors that this process is bound to."""
    count = getattr(os, "process_cpu_count", None)  # from Python 3.13 on
    if count is not None:
        return count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def bands(rows: int, height: int) -> list[Band]:
    """Parts of `height` rows at most."""
    return [(top, min(top + height, rows)) for top in range(0, rows, height)]


def picture_bands(rows: int, width: int) -> list[Band]:
    """Bands of rows of a picture, each large enough to be worth a thread.

    Args:
        rows: of the picture.
        width: pixels of a row.
    """
    return bands(rows, max(1, _BAND_PX // max(width, 1)))


def parallel_for(work: Callable[[T], None], items: Iterable[T], workers: int | None = None) -> None:
    """Run `work` on all items in parallel, in any order, and wait for all.

    The calling thread works too, and helpers that have not started are cancelled, so nested calls
    and a busy pool cannot deadlock.

    Args:
        work: releases the interpreter's lock for most of its time.
        items: what to work on.
        workers: how many items at a time at most; default: `processors()`, also the upper limit.
    """
    left = deque(items)
    own = not getattr(_thread, "counted", False)  # else a thread of a call around this one

    def drain() -> None:
        while True:
            try:
                item = left.popleft()
            except IndexError:
                return
            work(item)

    def helped() -> None:
        _thread.counted = True
        try:
            drain()
        finally:
            _thread.counted = False
            _given_back(1)

    wanted = len(left) if workers is None else min(workers, len(left))
    helpers = _taken(int(own), max(0, wanted - 1))
    futures: list[Future[None]] = []
    try:
        _thread.counted = True
        for _ in range(helpers):
            futures.append(_threads().submit(helped))
        drain()
    finally:
        started = [future for future in futures if not future.cancel()]
        if own:
            _thread.counted = False
        _given_back(own + helpers - len(started))
        wait(started)
    for future in started:
        future.result()


def _taken(own: int, helpers: int) -> int:
    """Count in `own` threads, and of the helpers as many as there are idle processors."""
    global _at_work
    with _lock:
        _at_work += own
        if helpers > 0:
            helpers = max(0, min(helpers, processors() - _at_work))
        _at_work += helpers
    return helpers


def _given_back(threads: int) -> None:
    global _at_work
    with _lock:
        _at_work -= threads


def parallel_map(work: Callable[[T], R], items: Sequence[T], workers: int | None = None) -> list[R]:
    """Results of `work` for each item, in order, computed in parallel by so many at most."""
    made: dict[int, R] = {}

    def do(at: int) -> None:
        made[at] = work(items[at])

    parallel_for(do, range(len(items)), workers)
    return [made[at] for at in range(len(items))]


def run_all(jobs: Iterable[Callable[[], None]], workers: int | None = None) -> None:
    """Run different jobs in parallel and wait for all."""
    parallel_for(lambda job: job(), jobs, workers)


def _threads() -> ThreadPoolExecutor:
    global _pool  # one pool a process is the point
    with _lock:
        if _pool is None:
            _pool = ThreadPoolExecutor(max(1, processors() - 1), thread_name_prefix="kernels")
        return _pool


def _forget() -> None:
    """In a forked child: the parent's threads are gone, and its lock may be held for ever."""
    global _pool, _lock, _thread, _at_work
    _pool, _lock, _thread, _at_work = None, threading.Lock(), threading.local(), 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
