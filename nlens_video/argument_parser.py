"""What the parsers of several commands share: errors, the plate, the encoding."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, NoReturn, TextIO, cast

from nlens_video import __version__
from nlens_video.errors import UsageError
from nlens_video.standard_output import print_out

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


class Parser(argparse.ArgumentParser):
    """Errors are ours: one line, no usage dump.

    Attributes:
        often: options that the help shows; empty for all of them.
        whole: the command whose help has the others.
    """

    often: frozenset[str] = frozenset()
    whole: str = ""

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError."""
        raise UsageError(f"{message}; see {self.prog} --help")

    def _print_message(self, message: str, file: SupportsWrite[str] | None = None) -> None:
        """Help and version, whose reader may have gone: early versions of 3.11 let that escape."""
        print_out(message, cast("TextIO | None", file))

    def format_help(self) -> str:
        """All of it, or what is used often and fits on a screen."""
        if not self.often:
            return super().format_help()
        formatter = argparse.RawDescriptionHelpFormatter(self.prog)
        formatter.add_text(self.description)
        formatter.start_section("often used")
        formatter.add_arguments(
            action for action in self._actions if self.often & set(action.option_strings)
        )
        formatter.end_section()
        formatter.add_text(f"All options: {self.whole} --help")
        return formatter.format_help()


def base_parser(prog: str, description: str) -> Parser:
    """A command's parser, with what every command knows."""
    parser = Parser(
        prog=prog, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"nlens-video {__version__}")
    parser.add_argument("-v", "--verbose", action="store_true", help="tell more; tracebacks")
    parser.add_argument("-q", "--quiet", action="store_true", help="errors only")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    return parser


def add_range(parser: Parser, meaning: str = "frames A to B-1, counted from 0") -> None:
    """How the plate is read, and which part of it."""
    add_source(parser).add_argument(
        "--range", metavar="A:B", type=_frames, default=(0, None), help=meaning
    )


def add_source(parser: Parser) -> argparse._ArgumentGroup:
    """How the plate is read."""
    raw = parser.add_argument_group("the plate")
    raw.add_argument("--input-format", metavar="F", help="FFmpeg's name: rawvideo, lavfi, v4l2 …")
    raw.add_argument("--input-size", metavar="WxH", type=_size, help="of raw video")
    raw.add_argument("--input-rate", metavar="FPS", help="of raw video, stills, sequences")
    raw.add_argument(
        "--input-transfer", metavar="NAME", type=_transfer,
        help="srgb, bt709, linear …, where the plate's tag is wrong",
    )  # fmt: skip
    return raw


def add_encoding(parser: Parser) -> None:
    """How the result is written."""
    out = parser.add_argument_group("the encoding (default: as the source)")
    out.add_argument("--codec", metavar="NAME")
    out.add_argument("--crf", metavar="Q", type=float)
    out.add_argument("--pix-fmt", metavar="NAME")
    out.add_argument("--keep-partial", action="store_true", help="keep what an interrupt leaves")


def _transfer(text: str) -> str:
    from nlens_video.color import TRANSFERS  # here: the help does without NumPy

    names = {**{name: name for name in TRANSFERS.values()}, "srgb": "iec61966-2-1"}
    if text not in names:
        raise argparse.ArgumentTypeError(f"'{text}': expected one of {', '.join(sorted(names))}")
    return names[text]


def _frames(text: str) -> tuple[int, int | None]:
    first, colon, end = text.partition(":")
    try:
        frames = (int(first or 0), int(end) if end else None)
    except ValueError:
        colon = ""
    if not colon or frames[0] < 0 or (frames[1] is not None and frames[1] <= frames[0]):
        raise argparse.ArgumentTypeError(f"{text!r} is not A:B with 0 <= A < B")
    return frames


def positive(text: str) -> float:
    """A number above 0, from a word."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def count(text: str) -> int:
    """A number from 1 on, from a word."""
    if not text.isdigit() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 on")
    return int(text)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, such as 960x512")
    return int(width), int(height)
