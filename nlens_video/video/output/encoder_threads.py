"""Encoders' threads run beside all others, or after them, not before them."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import av
from av.codec.codec import Capabilities

_TASKS = Path("/proc/self/task")
_STEPS = 10  # of niceness
_LEAST_URGENT = 19


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


def open_in_background(open_encoder: Callable[[], None]) -> None:
    """Open an encoder whose threads give way to the other ones of the process.

    An encoder gets one picture at a time and works on it on all processors. Meanwhile the lane that
    makes the next one would have to wait, and a processor would be idle afterwards. On Linux each
    thread has its own niceness and inherits it; elsewhere the threads are as urgent as all others.

    Args:
        open_encoder: starts the encoder's threads.

    Raises:
        Whatever it raises.
    """

    def open_it() -> None:
        if sys.platform == "linux":
            thread = threading.get_native_id()
            niceness = os.getpriority(os.PRIO_PROCESS, thread) + _STEPS
            os.setpriority(os.PRIO_PROCESS, thread, min(niceness, _LEAST_URGENT))
        open_encoder()

    # a thread of its own, for only root can make one more urgent again
    with ThreadPoolExecutor(1, "open-encoder") as beside:
        beside.submit(open_it).result()


def thread_type(encoder: str, *, live: bool) -> str:
    """FFmpeg's threads of an encoder.

    With frame threads an encoder holds back as many frames as it has threads, and raw frames gain
    nothing by them.

    Args:
        encoder: FFmpeg's name of it.
        live: whether the source is a stream, whose frames are not to wait.
    """
    holds_back = av.Codec(encoder, "w").capabilities & Capabilities.frame_threads
    return "SLICE" if holds_back and (live or encoder == "rawvideo") else "AUTO"
