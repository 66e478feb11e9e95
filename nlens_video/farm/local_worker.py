"""One task at a time in this process, beside what workers do elsewhere."""

from __future__ import annotations

import threading

from nlens_video.core.errors import NlensError
from nlens_video.farm.shot_tasks import Task
from nlens_video.farm.worker import Worker


class _Stopped(Exception):
    """Nobody wants the result any more."""


class OwnHand:
    """Does a task on a thread; asks it to look now and then whether it is still wanted."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._answer: object = None

    def start(self, task: Task) -> None:
        """Begin a task; the work of one that follows others takes `look`, which it calls often."""
        looking = {"look": self._look} if task.follows else {}

        def work() -> None:
            try:
                with Worker() as bench:
                    self._answer = task.work(bench, *task.arguments, **looking)
            except BaseException as error:  # noqa: BLE001 - handed on by `take`
                self._answer = error

        self._stop.clear()
        self._thread = threading.Thread(target=work, name="nlens-own-hand", daemon=True)
        self._thread.start()

    def ready(self, patience_s: float) -> bool:
        """Whether the task has come to its end, which is waited for so long at most [s]."""
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

    def drop(self) -> None:
        """End the task at hand; what it was writing goes."""
        if self._thread is not None:
            self._stop.set()
            self._thread.join()
            self._thread = self._answer = None

    def _look(self) -> None:
        if self._stop.is_set():
            raise _Stopped
