"""Signals that end a run, heard once, wherever they arrive.

A KeyboardInterrupt that is raised while FFmpeg calls back into Python is lost on the way, so the
signal is also remembered, and long loops look.
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
    """A signal handler: the first signal interrupts, later ones do not disturb the cleaning up."""
    if not requested.is_set():
        requested.set()
        raise KeyboardInterrupt


def stays_ignored(number: signal.Signals) -> bool:
    """Whether whoever started the process has it ignore a signal: `nohup` does with SIGHUP."""
    return number.name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN


def check() -> None:
    """Raise the interrupt that got lost, if there was one.

    Raises:
        KeyboardInterrupt: a signal was heard.
    """
    if requested.is_set():
        raise KeyboardInterrupt
