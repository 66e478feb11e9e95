"""Termination signals: the first one interrupts, and long loops poll for it.

A KeyboardInterrupt raised while FFmpeg calls back into Python is lost, so the handler also sets a
flag, which long loops poll. One raised while Python imports or starts a thread would leave a lock
that it holds, or a thread that nobody knows, and the process would never end: it waits.
"""

from __future__ import annotations

import concurrent.futures.thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
requested = threading.Event()
_complete = threading.Event()
_ALARM = getattr(signal, "SIGALRM", None)
_SOON_S = 0.02  # until a signal that came at a bad moment is looked at again [s]
_LATEST = 250  # times that it is looked at [1]
_IMPORTING = "<frozen importlib._bootstrap>"
_STARTING = {
    (threading.__file__, "start"),
    (concurrent.futures.thread.__file__, "submit"),
}
_waited = 0


def handler(number: int, frame: FrameType | None) -> None:
    """Signal handler: the first signal interrupts; during clean-up and at the end none does."""
    global _waited
    if requested.is_set() or _complete.is_set():
        return
    if _ALARM is not None and _waited < _LATEST and _holds_locks(frame):
        _waited += 1
        signal.setitimer(signal.ITIMER_REAL, _SOON_S)
        return
    requested.set()
    raise KeyboardInterrupt


def _holds_locks(frame: FrameType | None) -> bool:
    """Whether Python imports a module or starts a thread there."""
    while frame is not None:
        code = frame.f_code
        if code.co_filename == _IMPORTING or (code.co_filename, code.co_name) in _STARTING:
            return True
        frame = frame.f_back
    return False


def check() -> None:
    """Raise the interrupt if a termination signal has arrived.

    Raises:
        KeyboardInterrupt: a signal has arrived.
    """
    if requested.is_set():
        raise KeyboardInterrupt


def complete() -> None:
    """Ignore termination signals that come from now on: all that was asked for is written."""
    _complete.set()


@contextmanager
def interruptible(*, ends: bool = False) -> Iterator[None]:
    """SIGTERM and the like end a run as Ctrl-C does; a second one does not disturb the clean-up.

    A SIGHUP that the parent process had ignored, as `nohup` does, stays ignored.

    Args:
        ends: whether the process ends afterwards, so that a signal comes too late.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    global _waited
    requested.clear()
    _complete.clear()
    _waited = 0
    looked_at = ENDING if _ALARM is None else (*ENDING, _ALARM)
    before = {number: signal.getsignal(number) for number in looked_at}
    if before.get(getattr(signal, "SIGHUP", None)) is signal.SIG_IGN:
        del before[signal.SIGHUP]
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        if ends:
            complete()
        for number, earlier in before.items():
            ignored = (ends or requested.is_set()) and number != _ALARM
            signal.signal(number, signal.SIG_IGN if ignored else earlier)
