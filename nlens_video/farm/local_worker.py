"""Runs one task at a time in a thread of this process, beside the workers of the cluster."""

from __future__ import annotations

import threading

from nlens_video.core.errors import NlensError
from nlens_video.farm.shot_tasks import Task
from nlens_video.farm.worker import Worker


class _Stopped(Exception):
    """The task was cancelled."""


class LocalWorker:
    """Runs one task in a thread; the task polls for cancellation."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._answer: object = None

    def start(self, task: Task) -> None:
        """Start a task; one that follows others is called with `poll`, which it calls often."""
        polling = {"poll": self._poll} if task.follows else {}

        def work() -> None:
            try:
                with Worker() as worker:
                    self._answer = task.work(worker, *task.arguments, **polling)
            except BaseException as error:  # noqa: BLE001 - raised by `take`
                self._answer = error

        self._stop.clear()
        self._thread = threading.Thread(target=work, name="nlens-local-worker", daemon=True)
        self._thread.start()

    def ready(self, patience_s: float) -> bool:
        """Whether the task has ended; waits at most `patience_s` for it [s]."""
        if self._thread is not None:
            self._thread.join(patience_s)
        return self._thread is None or not self._thread.is_alive()

    def take(self) -> object:
        """What the task returned, or the `NlensError` that it raised, once it is `ready`.

        Raises:
            Whatever else it raised.
        """
        self._thread = None
        answer, self._answer = self._answer, None
        if isinstance(answer, BaseException) and not isinstance(answer, NlensError):
            raise answer
        return answer

    def cancel(self) -> None:
        """Cancel the task; it removes its partial files."""
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = self._answer = None

    def _poll(self) -> None:
        if self._stop.is_set():
            raise _Stopped
