"""Work shared among the process' processors, on threads that are made once."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None


def processors() -> int:
    """How many processors this process may use: not all, where a container or taskset forbids."""
    count = getattr(os, "process_cpu_count", None)  # from Python 3.13 on
    if count is not None:
        return count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def parallel_for(work: Callable[[T], None], items: Iterable[T], workers: int | None = None) -> None:
    """Do `work` on all items, in any order and side by side; wait until all is done.

    The calling thread is one of the workers, and no helper that did not start is waited for. So
    this ends even while others keep the pool busy, and from within `work` too.

    Args:
        work: releases the interpreter's lock for most of its time.
        items: what to work on.
        workers: how many items at a time at most; default: `processors()`, also the upper limit.
    """
    left = deque(items)

    def drain() -> None:
        while True:
            try:
                item = left.popleft()
            except IndexError:
                return
            work(item)

    wanted = processors() if workers is None else workers
    helpers = min(wanted, len(left)) - 1
    futures = [_threads().submit(drain) for _ in range(helpers)]
    try:
        drain()
    finally:
        started = [future for future in futures if not future.cancel()]
        wait(started)
    for future in started:
        future.result()


def parallel_map(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """What `work` makes of each item, in their order, made side by side as by `share`."""
    made: dict[int, R] = {}

    def do(at: int) -> None:
        made[at] = work(items[at])

    parallel_for(do, range(len(items)))
    return [made[at] for at in range(len(items))]


def run_all(jobs: Iterable[Callable[[], None]], workers: int | None = None) -> None:
    """Run jobs of several kinds as `share` does work on items: one wait for all of them."""
    parallel_for(_run, jobs, workers)


def _run(job: Callable[[], None]) -> None:
    job()


def _threads() -> ThreadPoolExecutor:
    global _pool  # one pool a process is the point
    with _lock:
        if _pool is None:
            _pool = ThreadPoolExecutor(max(1, processors() - 1), thread_name_prefix="kernels")
        return _pool


def _forget() -> None:
    """A forked child has none of its parent's threads, and perhaps a lock that one of them held."""
    global _pool, _lock
    _pool, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
