"""A pseudo-terminal for tests: starts a program on it, types, resizes, and reads the screen."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Self

import pyte

CTRL_C, CTRL_Z = "\x03", "\x1a"
PATIENCE_S = 300.0
"""How long a test waits for what must come; reaching it is a failure, not a measurement."""
# The first terminal that a session's leader opens becomes the one its keys are read from.
_ON_TERMINAL = 'tty=$1; shift; exec "$@" <"$tty" >"$tty" 2>&1'


class Terminal:
    """A program on a pseudo-terminal of its own, as its session's leader.

    Args:
        command: the program and its words.
        columns, rows: size of the screen [characters].
        environment: changes to this process's environment; None removes a variable.

    Attributes:
        raw: every byte that the program has written.
        screens: distinct states of the screen, in their order, each a text of lines.
    """

    def __init__(
        self,
        command: Sequence[object],
        *,
        columns: int = 80,
        rows: int = 24,
        environment: Mapping[str, str | None] | None = None,
    ) -> None:
        self.raw = b""
        self.screens: list[str] = []
        self._screen = pyte.Screen(columns, rows)
        self._stream = pyte.ByteStream(self._screen)
        changed = {"TERM": "xterm-256color", "COLUMNS": None, "LINES": None, **(environment or {})}
        whole = {**os.environ, **changed}
        self._master, self._slave = pty.openpty()
        self._size(columns, rows)
        self._process = subprocess.Popen(
            ["sh", "-c", _ON_TERMINAL, "sh", os.ttyname(self._slave), *map(str, command)],
            env={name: value for name, value in whole.items() if value is not None},
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        os.close(self._slave)
        os.close(self._master)

    @property
    def pid(self) -> int:
        """The program's process."""
        return self._process.pid

    @property
    def screen(self) -> str:
        """What is to be seen: lines without trailing blanks."""
        return "\n".join(line.rstrip() for line in self._screen.display).rstrip()

    @property
    def text(self) -> str:
        """All that was written, control sequences among it."""
        return self.raw.decode("utf-8", "replace")

    def type(self, keys: str) -> None:
        """Press keys."""
        os.write(self._master, keys.encode())

    def resize(self, columns: int, rows: int = 24) -> None:
        """Change the size, which sends SIGWINCH."""
        self._screen.resize(rows, columns)
        self._size(columns, rows)

    def wait_for(self, what: str | Callable[[str], bool]) -> str:
        """Read until the screen holds a text, or fulfils a condition; returns the screen."""
        fulfilled = what if callable(what) else lambda screen: what in screen
        deadline = time.monotonic() + PATIENCE_S
        while not fulfilled(self.screen):
            came = self._read(0.1)
            assert came or self._process.poll() is None, f"ended, not {what}:\n{self.screen}"
            assert time.monotonic() < deadline, f"waited for {what}; the screen:\n{self.screen}"
        return self.screen

    def end(self) -> int:
        """Read until the program ends; returns its exit code, or minus the number of a signal."""
        deadline = time.monotonic() + PATIENCE_S
        while self._read(0.1) or self._process.poll() is None:
            assert time.monotonic() < deadline, f"did not end; the screen:\n{self.screen}"
        return self._process.wait()

    def _read(self, wait_s: float) -> bytes:
        """What comes within a moment, onto the screen."""
        if not select.select([self._master], [], [], wait_s)[0]:
            return b""
        came = os.read(self._master, 65536)
        self.raw += came
        self._stream.feed(came)
        if not self.screens or self.screens[-1] != self.screen:
            self.screens.append(self.screen)
        return came

    def _size(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


def program(*words: object) -> list[str]:
    """The command line of nlens-video, in the Python that runs the tests."""
    return [sys.executable, "-m", "nlens_video", *map(str, words)]
