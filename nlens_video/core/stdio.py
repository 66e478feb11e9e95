"""Standard streams: input and output for data, error for messages.

Each may be closed from the start, lose its reader, or lack characters in its encoding.
"""

from __future__ import annotations

import codecs
import io
import os
import re
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TextIO, cast

from nlens_video.core.errors import OutputError, ReaderGone

_PLAIN = {"…": "...", "±": "+-", "·": "*", "–": "-", "−": "-", "×": "x", "→": "->", "°": " deg"}
_CHARACTERS = "nlens_video.plain"
_CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
codecs.register_error(_CHARACTERS, lambda error: _plainly(error))


def prepare_streams() -> None:
    """Reserve the descriptors 0 to 2, and make all text encodable.

    A file opened while standard output or error is closed would get its descriptor, and with it
    whatever libraries print.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor, which is this one
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_CHARACTERS)


class StandardInput(io.FileIO):
    """The bytes of standard input as they come: a read gives what is there.

    `sys.stdin` waits until it has all that is asked for, which holds back small packets.
    """

    def __init__(self) -> None:
        super().__init__(sys.stdin.fileno(), closefd=False)

    def read(self, size: int | None = -1, /) -> bytes:
        """What is there, up to a number of bytes; it is waited for, and empty at the end."""
        while (data := super().read(-1 if size is None else size)) is None:
            select.select([self], [], [])  # another program made the pipe non-blocking
        return data


def _plainly(error: UnicodeError) -> tuple[bytes, int]:
    """Replacement of characters that a stream's encoding lacks.

    Undecodable bytes of file names (surrogate escapes) are written as they were.
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
    """Write text; nothing where the stream was closed from the start.

    Args:
        text: with its final newline.
        stream: where to; default: standard output.

    Raises:
        ReaderGone: the reader closed the stream.
        OutputError: it cannot be written.
    """
    out: TextIO | None = sys.stdout if stream is None else stream
    if out is None:
        return
    try:
        out.write(text)
        out.flush()
    except BrokenPipeError as error:
        raise ReaderGone("standard output: its reader closed it") from error
    except OSError as error:
        redirect_to_devnull(out)
        raise OutputError(
            f"standard output: cannot be written ({error.strerror}); check the disk"
        ) from error


def drop_unwritten(stream: TextIO | None) -> None:
    """Give up what a stream holds and cannot write, such as on a full disk."""
    if stream is None:
        return
    try:
        stream.flush()
    except OSError:
        redirect_to_devnull(stream)


def redirect_to_devnull(stream: TextIO) -> None:
    """Redirect a stream to the null device: Python would fail again when it flushes it at exit."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def standard_error() -> TextIO:
    """The current standard error; a failure to write to it is ignored."""
    return cast("TextIO", _Forgiving(sys.stderr))


class _Forgiving(io.TextIOBase):
    """Writes to a stream and ignores failures.

    It keeps its stream: code that replaces `sys.stderr` by a wrapper of this one would recurse
    endlessly if each write looked `sys.stderr` up.

    Args:
        stream: where to; None where it was closed from the start.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]  # read-only here, as of io.TextIOWrapper
        """Encoding of the stream."""
        return getattr(self._stream, "encoding", None) or "utf-8"

    def write(self, text: str) -> int:
        """Write; after a failure discard all that follows."""
        if self._stream is not None:
            try:
                self._stream.write(text)
                self._stream.flush()
            except OSError:
                redirect_to_devnull(self._stream)
        return len(text)

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream is not None and self._stream.isatty()


class _BytesOnly(io.TextIOBase):
    """Standard output for bytes; text goes to standard error."""

    def __init__(self, real: TextIO) -> None:
        self._real = real
        self._words = standard_error()

    @property
    def buffer(self) -> object:
        """The binary stream."""
        return self._real.buffer

    def fileno(self) -> int:
        """Descriptor of the real stream."""
        return self._real.fileno()

    def write(self, text: str) -> int:
        """Write to standard error."""
        return self._words.write(text)


@contextmanager
def redirect_library_stdout() -> Iterator[None]:
    """Redirect what libraries print to standard error: standard output may carry data."""
    if sys.stdout is None:  # closed from the start
        yield
        return
    with redirect_stdout(_BytesOnly(sys.stdout)):
        yield
