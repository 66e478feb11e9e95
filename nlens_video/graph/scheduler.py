"""Pipeline parallelism: lanes on a thread each, with bounded queues between them.

Items stay in order, at most `depth` of them wait before each lane, a fault in any lane is raised at
the consumer, and closing the stream ends every thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import AbstractContextManager, ExitStack
from queue import Empty, Full, Queue
from typing import Any, Generic, TypeVar

from msgspec import Struct

from nlens_video.core import signals

T = TypeVar("T")
_POLL_S = 0.05
_PATIENCE_S = 2.0  # a read that blocks longer than this after closing (a camera gone quiet) is left
_left_reading: list[threading.Event] = []  # of each reader that was left, set when it comes back


class Worker(Struct, Generic[T], frozen=True):
    """One step of the stream.

    Attributes:
        name: of its thread.
        opened: gives a context manager that is entered and left on the lane's own thread (an OpenGL
            context must stay there) and yields the function that every item passes through.
    """

    name: str
    opened: Callable[[], AbstractContextManager[Callable[[T], T]]]


class _Fault(Struct, frozen=True):
    error: BaseException


class _End:
    """Marks the end of the stream."""


_Message = object


class _Stopped(Exception):
    """The consumer has closed the stream."""


class _Link:
    """A bounded queue that gives up when the stream is closed."""

    def __init__(self, depth: int, stop: threading.Event) -> None:
        self._queue: Queue[_Message] = Queue(maxsize=depth)
        self._stop = stop

    def put(self, message: _Message, may_drop: Callable[[Any], bool] | None = None) -> None:
        """Wait for room, or make it by leaving out the oldest message that may be dropped."""
        while not self._stop.is_set():
            if may_drop is not None and self._queue.full():
                self._drop(may_drop)
            try:
                return self._queue.put(message, timeout=_POLL_S)
            except Full:
                continue
        raise _Stopped

    def _drop(self, may_drop: Callable[[Any], bool]) -> None:
        with self._queue.mutex:
            waiting = self._queue.queue
            for at, message in enumerate(waiting):
                if may_drop(message):
                    del waiting[at]
                    self._queue.not_full.notify()
                    return

    def get(self, poll: Callable[[], None] | None = None) -> _Message:
        while not self._stop.is_set():
            try:
                return self._queue.get(timeout=_POLL_S)
            except Empty:
                if poll is not None:
                    poll()
        raise _Stopped


def run_workers(
    source: Iterable[T],
    lanes: Sequence[Worker[T]],
    depth: int = 2,
    *,
    may_drop: Callable[[T], bool] | None = None,
) -> Generator[T]:
    """Pull `source` on a thread of its own and pass every item through the lanes, in order.

    Args:
        source: the items; iterated and, when a generator, closed on the first thread.
        lanes: the steps.
        depth: items that may wait before each lane [1].
        may_drop: asked, the oldest first, about items that wait for the first lane when a new one
            finds no room: what it says yes to is left out. Default: the source waits.

    Yields:
        The items, as the last lane returns them.

    Raises:
        Whatever the source or a lane raised, after the items before it.
    """
    stop = threading.Event()
    links = [_Link(depth, stop) for _ in range(len(lanes) + 1)]
    read = threading.Event()
    threads = [
        threading.Thread(
            target=_feed, args=(source, links[0], read, may_drop), name="decode", daemon=True
        )
    ]
    for lane, inlet, outlet in zip(lanes, links[:-1], links[1:], strict=True):
        threads.append(
            threading.Thread(target=_work, args=(lane, inlet, outlet), name=lane.name, daemon=True)
        )
    for thread in threads:
        thread.start()
    try:
        while True:
            message = links[-1].get(signals.check)
            if isinstance(message, _Fault):
                raise message.error
            if isinstance(message, _End):
                return
            yield message  # type: ignore[misc]  # what is neither fault nor end is an item
    finally:
        stop.set()
        for thread in threads[1:]:
            thread.join()
        if read.wait(_PATIENCE_S):
            threads[0].join()
        else:
            _left_reading.append(read)


def run_in_thread(work: Callable[[], T]) -> T:
    """Run a blocking call on a thread of its own, so that Ctrl-C still interrupts.

    Raises:
        Whatever the work raises.
    """
    return begin_in_thread(work)()


def begin_in_thread(work: Callable[[], T]) -> Callable[[], T]:
    """Begin a call on a thread of its own; what is returned waits for it.

    The wait gives what the call returns and raises what it raises; Ctrl-C interrupts it.
    """
    outcome: list[T | BaseException] = []
    done = threading.Event()

    def attempt() -> None:
        try:
            outcome.append(work())
        except BaseException as error:  # noqa: BLE001 - handed on, raised at the consumer
            outcome.append(error)
        finally:
            done.set()

    def wait() -> T:
        try:
            # an interrupted Thread.join would take the thread for ended: an event is waited for
            while not done.wait(_POLL_S):
                signals.check()  # an interrupt that arrived during an import may be lost there
        except BaseException:
            _left_reading.append(done)
            raise
        if isinstance(outcome[0], BaseException):
            raise outcome[0]
        return outcome[0]

    threading.Thread(target=attempt, name="begun", daemon=True).start()
    return wait


def reader_blocked() -> bool:
    """Whether a closed stream's source still blocks in a read; it must not be closed under it."""
    return any(not done.is_set() for done in _left_reading)


def _feed(
    source: Iterable[T],
    outlet: _Link,
    read: threading.Event,
    may_drop: Callable[[T], bool] | None,
) -> None:
    with ExitStack() as stack:
        stack.callback(read.set)
        if isinstance(source, Generator):
            stack.callback(source.close)
        try:
            for item in source:
                outlet.put(item, may_drop)
            outlet.put(_End())
        except _Stopped:
            return
        except BaseException as error:  # noqa: BLE001 - handed on to the caller
            _hand_on(outlet, error)


def _work(lane: Worker[T], inlet: _Link, outlet: _Link) -> None:
    try:
        with lane.opened() as step:
            while True:
                message = inlet.get()
                if isinstance(message, _Fault | _End):
                    outlet.put(message)
                    return
                outlet.put(step(message))  # type: ignore[arg-type]  # an item, as above
    except _Stopped:
        return
    except BaseException as error:  # noqa: BLE001 - handed on, raised at the consumer
        _hand_on(outlet, error)


def _hand_on(outlet: _Link, error: BaseException) -> None:
    try:
        outlet.put(_Fault(error))
    except _Stopped:
        return
