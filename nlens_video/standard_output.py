"""Text on standard output, whose reader may have seen enough."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TextIO

from nlens_video.errors import ReaderGone


class _BytesOnly(io.TextIOBase):
    """Standard output for pictures; text goes to standard error."""

    def __init__(self, real: TextIO) -> None:
        self._real = real

    @property
    def buffer(self) -> object:
        """Where bytes go."""
        return self._real.buffer

    def fileno(self) -> int:
        """The real one's."""
        return self._real.fileno()

    def write(self, text: str) -> int:
        """Write to standard error."""
        return sys.stderr.write(text)


@contextmanager
def kept_from_libraries() -> Iterator[None]:
    """What libraries print goes to standard error: pictures or JSON may go to standard output."""
    with redirect_stdout(_BytesOnly(sys.stdout)):
        yield


def print_out(text: str, stream: TextIO | None = None) -> None:
    """Write text as it is.

    Args:
        text: with its last line's end.
        stream: where to; default: standard output.

    Raises:
        ReaderGone: nobody reads it any more.
    """
    out = sys.stdout if stream is None else stream
    try:
        out.write(text)
        out.flush()
    except BrokenPipeError as error:
        raise ReaderGone("standard output: nobody reads it any more") from error
