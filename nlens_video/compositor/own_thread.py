"""A thread of one's own for work that must stay on one, such as OpenGL's."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from nlens_video.core.errors import UsageError

R = TypeVar("R")


class OwnThread:
    """Does work in the order of the calls, from whichever thread they come, until it is closed.

    Args:
        free: run on the thread when it is closed.
    """

    def __init__(self, free: Callable[[], None]) -> None:
        self._free = free
        self._closed = False
        self._gate = threading.Lock()
        self._process = os.getpid()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="nlens-compositor")

    def call(self, work: Callable[[], R]) -> R:
        """Do the work there, and wait for what it returns.

        Raises:
            UsageError: it is closed, or belongs to another process.
        """
        if os.getpid() != self._process:
            raise UsageError("the compositor was made by another process; make one in each")
        with self._gate:  # nothing gets in between the last frame and the freeing
            if self._closed:
                raise UsageError("the compositor is closed; make a new one")
            asked = self._worker.submit(work)
        return asked.result()

    def close(self) -> None:
        """Free what was held and end the thread; harmless when repeated."""
        if os.getpid() != self._process:  # its thread, and OpenGL, are the other process's
            return
        with self._gate:
            freed = None if self._closed else self._worker.submit(self._free)
            self._closed = True
        if freed is not None:
            freed.result()
        self._worker.shutdown()
