"""Encoders' threads run beside all others, not before them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_TASKS = Path("/proc/self/task")


@contextmanager
def ordinary_priority() -> Iterator[None]:
    """Threads that become real-time ones meanwhile are ordinary ones after it.

    SVT-AV1 that root opens gives the calling thread and its own ones the highest real-time
    priority. All that such a thread starts later inherits it, programs too, and with few processors
    nothing else on the machine runs any more. Its thirty lines about itself are not written.
    """
    os.environ.setdefault("SVT_LOG", "1")  # errors
    if not _TASKS.is_dir() or _is_realtime(0):  # all of it is one by the user's wish
        yield
        return
    try:
        yield
    finally:
        for task in _TASKS.iterdir():
            with suppress(OSError):  # it has ended, or it was not an encoder that raised it
                if _is_realtime(int(task.name)):
                    os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))


def _is_realtime(thread: int) -> bool:
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return policy in (os.SCHED_FIFO, os.SCHED_RR)
