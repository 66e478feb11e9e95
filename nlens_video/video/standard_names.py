"""Other names of the standard streams: FFmpeg's `pipe:0`, the system's `/dev/stdin`."""

from __future__ import annotations

STANDARD = "-"
_INPUT = ("pipe:", "pipe:0", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0")
_OUTPUT = ("pipe:", "pipe:1", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")


def input_name(text: str) -> str:
    """A plate's name, `-` where it is another name of standard input."""
    return STANDARD if text in _INPUT else text


def output_name(text: str) -> str:
    """A result's name, `-` where it is another name of standard output."""
    return STANDARD if text in _OUTPUT else text
