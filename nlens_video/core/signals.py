"""Termination signals: the first one interrupts, and long loops poll for it.

A KeyboardInterrupt raised while FFmpeg calls back into Python is lost, so the handler also sets a
flag, which long loops poll.
"""

from __future__ import annotations

import signal
import threading
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


def stays_ignored(number: signal.Signals) -> bool:
    """Whether the parent process had a signal ignored, as `nohup` does with SIGHUP."""
    return number.name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN


def check() -> None:
    """Raise the interrupt if a termination signal has arrived.

    Raises:
        KeyboardInterrupt: a signal has arrived.
    """
    if requested.is_set():
        raise KeyboardInterrupt
