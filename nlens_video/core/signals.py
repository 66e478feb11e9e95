"""Termination signals: the first one interrupts, and long loops poll for it.

A KeyboardInterrupt raised while FFmpeg calls back into Python is lost, so the handler also sets a
flag, which long loops poll.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
requested = threading.Event()


def handler(number: int, frame: FrameType | None) -> None:
    """Signal handler: the first signal interrupts, later ones are ignored during clean-up."""
    if not requested.is_set():
        requested.set()
        raise KeyboardInterrupt


def check() -> None:
    """Raise the interrupt if a termination signal has arrived.

    Raises:
        KeyboardInterrupt: a signal has arrived.
    """
    if requested.is_set():
        raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM and the like end a run as Ctrl-C does; a second one does not disturb the clean-up.

    A SIGHUP that the parent process had ignored, as `nohup` does, stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    requested.clear()
    before = {number: signal.getsignal(number) for number in ENDING}
    if before.get(getattr(signal, "SIGHUP", None)) is signal.SIG_IGN:
        del before[signal.SIGHUP]
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, signal.SIG_IGN if requested.is_set() else earlier)
