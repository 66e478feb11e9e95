"""The standard streams: one for pictures and results, whose reader may go; one for words.

Each may be closed from the start, or unable to write every character.
"""

from __future__ import annotations

import codecs
import io
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TextIO, cast

from nlens_video.core.errors import OutputError, ReaderGone

_PLAIN = {"…": "...", "±": "+-", "·": "*", "–": "-", "−": "-", "×": "x", "→": "->", "°": " deg"}
_CHARACTERS = "nlens_video.plain"
_CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
codecs.register_error(_CHARACTERS, lambda error: _plainly(error))


def make_ready() -> None:
    """See that no file that is opened becomes a standard stream, and that all text can be written.

    A file that is opened where standard output or error was closed gets its number, and then what
    libraries write there.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free, which is this one
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_CHARACTERS)


def _plainly(error: UnicodeError) -> tuple[bytes, int]:
    """What stands for characters that a stream's encoding lacks.

    Names of files that are no text of that encoding are given back as the bytes that they are.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    written = b""
    for character in error.object[error.start : error.end]:
        lone = 0xDC80 <= ord(character) <= 0xDCFF
        errors = "surrogateescape" if lone else "backslashreplace"
        written += _PLAIN.get(character, character).encode("ascii", errors)
    return written, error.end


def escape_controls(text: str) -> str:
    r"""Text with its control characters, which could move the cursor or hide a part, spelled out.

    >>> escape_controls("plate\x1b[2J.mp4")
    'plate\\x1b[2J.mp4'
    """
    return _CONTROLS.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def print_out(text: str, stream: TextIO | None = None) -> None:
    """Write text as it is; where the stream was closed from the start, nobody asks for it.

    Args:
        text: with its last line's end.
        stream: where to; default: standard output.

    Raises:
        ReaderGone: nobody reads it any more.
        OutputError: it cannot be written.
    """
    out: TextIO | None = sys.stdout if stream is None else stream
    if out is None:
        return
    try:
        out.write(text)
        out.flush()
    except BrokenPipeError as error:
        raise ReaderGone("standard output: nobody reads it any more") from error
    except OSError as error:
        redirect_to_devnull(out)
        raise OutputError(
            f"standard output: cannot be written ({error.strerror}); check the disk"
        ) from error


def redirect_to_devnull(stream: TextIO) -> None:
    """Point a stream nowhere: Python would complain once more when it flushes it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def standard_error() -> TextIO:
    """Standard error as it is now; that it cannot be written or read is no failure of a run."""
    return cast("TextIO", _Forgiving(sys.stderr))


class _Forgiving(io.TextIOBase):
    """Writes to a stream where that can be done.

    It holds its stream: whoever puts a stream of their own in the place of `sys.stderr` writes to
    this one, and a look-up at each write would find theirs and write to it without end.

    Args:
        stream: where to; None where it was closed from the start.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]  # read-only here, as of io.TextIOWrapper
        """Which characters can be written."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    def write(self, text: str) -> int:
        """Write, or else stop trying."""
        if self._stream is not None:
            try:
                self._stream.write(text)
                self._stream.flush()
            except OSError:
                redirect_to_devnull(self._stream)
        return len(text)

    def isatty(self) -> bool:
        """Whether a person sees it at once."""
        return self._stream is not None and self._stream.isatty()


class _BytesOnly(io.TextIOBase):
    """Standard output for pictures; text goes to standard error."""

    def __init__(self, real: TextIO) -> None:
        self._real = real
        self._words = standard_error()

    @property
    def buffer(self) -> object:
        """Where bytes go."""
        return self._real.buffer

    def fileno(self) -> int:
        """The real one's."""
        return self._real.fileno()

    def write(self, text: str) -> int:
        """Write to standard error."""
        return self._words.write(text)


@contextmanager
def redirect_library_stdout() -> Iterator[None]:
    """What libraries print goes to standard error: pictures or JSON may go to standard output."""
    if sys.stdout is None:  # closed from the start
        yield
        return
    with redirect_stdout(_BytesOnly(sys.stdout)):
        yield
