"""Parallel loops over threads that release the interpreter's lock, and scratch arrays of each."""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

T = TypeVar("T")
R = TypeVar("R")
Band = tuple[int, int]
"""First row, and the one past the last."""

_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None


def processors() -> int:
    """Processors this process may use; fewer than the machine's in a container or by taskset."""
    count = getattr(os, "process_cpu_count", None)  # from Python 3.13 on
    if count is not None:
        return count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def bands(rows: int, height: int) -> list[Band]:
    """Parts of `height` rows at most."""
    return [(top, min(top + height, rows)) for top in range(0, rows, height)]


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
    """Results of `work` for each item, in order, computed in parallel."""
    made: dict[int, R] = {}

    def do(at: int) -> None:
        made[at] = work(items[at])

    parallel_for(do, range(len(items)))
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
    global _pool, _lock
    _pool, _lock = None, threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


class _Scratch(threading.local):
    """Buffers of one thread by name."""

    def __init__(self) -> None:
        self.buffers: dict[str, npt.NDArray[np.uint8]] = {}


_scratch = _Scratch()


def scratch(
    name: str, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float32
) -> npt.NDArray[Any]:
    """An array of any content, good until this thread asks for the same name again.

    It is reused from frame to frame, for page faults cost more than filling, and kept as large as
    the largest asked for.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    buffer = _scratch.buffers.get(name)
    if buffer is None or buffer.size < size:
        _scratch.buffers[name] = buffer = np.empty(size, np.uint8)
    return buffer[:size].view(dtype).reshape(shape)
