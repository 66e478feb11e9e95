"""Text on standard output, whose reader may have seen enough."""

from __future__ import annotations

import sys
from typing import TextIO

from nlens_video.errors import ReaderGone


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
