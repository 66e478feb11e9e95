"""Frames composited while the caller reads the next one and shows the one before."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from time import monotonic
from typing import Any, Literal, Self

import numpy.typing as npt

from nlens_video.compositor.compositor import Compositor
from nlens_video.core.errors import UsageError


class FrameQueue:
    """A bounded queue into a compositor: `submit` frames, take each `result` in the same order.

    Some threads may submit while others take results. Memory is bounded by `size` frames.

    Args:
        lens: composites the frames; closed by its owner.
        size: frames that may be waiting or composited and not yet taken, 1 or more [1].
        on_full: what `submit` does then: `wait` until a result is taken; `drop`, for cameras, the
            oldest frame that still waits, else the oldest result.

    Raises:
        UsageError: no whole size from 1 on, or another word.
    """

    def __init__(
        self, lens: Compositor, size: int = 3, *, on_full: Literal["wait", "drop"] = "wait"
    ) -> None:
        if not isinstance(size, int) or size < 1:
            raise UsageError(f"{size=}: expected a whole number of frames, 1 or more")
        if on_full not in ("wait", "drop"):
            raise UsageError(f"{on_full=}: expected one of wait, drop")
        self._lens, self._size, self._drops = lens, size, on_full == "drop"
        self._pending: deque[Future[npt.NDArray[Any]]] = deque()
        self._changed = threading.Condition()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="nlens-queue")
        self._closed = False
        self._submitted = 0
        self.dropped = 0
        """Frames that were left out so far [1]."""

    def submit(
        self, frame: npt.NDArray[Any], time: float | None = None,
        out: npt.NDArray[Any] | None = None,
    ) -> None:  # fmt: skip
        """Hand over a frame; returns before it is composited.

        Args:
            frame: as `Compositor.process` takes it; not to be changed until its result is taken.
            time: of the frame in the animation [s]; default: frames submitted so far / fps.
            out: array that takes the result, perhaps the frame itself.

        Raises:
            UsageError: the queue is closed.
        """
        with self._changed:
            if self._drops and len(self._pending) >= self._size:
                self._drop_oldest()
            self._changed.wait_for(lambda: self._closed or len(self._pending) < self._size)
            if self._closed:
                raise UsageError("the queue is closed; make a new one")
            composite, number = self._lens.process, self._submitted
            self._pending.append(self._worker.submit(composite, frame, time, out, number))
            self._submitted += 1
            self._changed.notify_all()

    def _drop_oldest(self) -> None:
        """Leave out the oldest frame that is not begun yet, else the oldest that is done."""
        waiting = (one for one in self._pending if one.cancel())
        done = (one for one in self._pending if one.done())
        left_out = next(waiting, None) or next(done, None)
        if left_out is not None:
            self._pending.remove(left_out)
            self.dropped += 1

    def result(self, timeout_s: float | None = None) -> npt.NDArray[Any] | None:
        """The oldest frame that was submitted and not taken yet, composited.

        Args:
            timeout_s: how long to wait for it; None: as long as it takes [s].

        Returns:
            None where the time ran out, or nothing was submitted and the queue is closed.

        Raises:
            NlensError: as `Compositor.process` on that frame, which is then taken.
        """
        until = None if timeout_s is None else monotonic() + timeout_s
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._pending, _left_s(until))
                if not self._pending:
                    return None
                oldest = self._pending[0]
            try:
                oldest.exception(_left_s(until))  # waits, and does not raise what it raised
            except CancelledError:
                continue  # `submit` left it out meanwhile, and another is the oldest
            except TimeoutError:
                return None
            with self._changed:
                if oldest not in self._pending:  # another thread took it, or `submit` left it out
                    continue
                self._pending.remove(oldest)
                self._changed.notify_all()
            return oldest.result()

    def close(self) -> None:
        """Take no more frames; results of those that were submitted can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._worker.shutdown(wait=True)

    def __len__(self) -> int:
        return len(self._pending)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _left_s(until: float | None) -> float | None:
    """Time until a moment of the monotonic clock, 0 after it; None where there is none [s]."""
    return None if until is None else max(until - monotonic(), 0.0)
