"""What the parsers of several commands share: errors, the plate, the encoding."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, cast

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.core.version import VERSION
from nlens_video.video.standard_names import input_name, output_name

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


_LARGEST = 1e9
"""Numbers beyond it are slips of the hand, and overflow somewhere."""
_LONGEST_NAME = 255  # of a file or folder, as Linux and macOS have it [byte]


class Parser(argparse.ArgumentParser):
    """Errors are ours: one line, no usage dump.

    Attributes:
        often: options that the help shows; empty for all of them.
        whole: the command whose help has the others.
    """

    often: frozenset[str] = frozenset()
    whole: str = ""

    def __init__(self, *words: Any, **named: Any) -> None:  # noqa: ANN401  argparse's own
        super().__init__(*words, **named)
        self.register("type", None, word)

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError."""
        raise UsageError(f"{message}; see {self.prog} --help")

    def parse_known_args(  # type: ignore[override]  # argparse declares it by overloads
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401  as argparse declares it
    ) -> tuple[Any, list[str]]:
        """Name the nearest option of one that is not known, before anything else is said."""
        words = list(sys.argv[1:] if args is None else args)
        if self._subparsers is None:
            self._check_options(words)
        return super().parse_known_args(self._joined(words), namespace)

    def _check_options(self, words: list[str]) -> None:
        for word in words:
            if word == "--":
                return
            name = word.partition("=")[0]
            if not name.startswith("--") or any(k.startswith(name) for k in self._names()):
                continue
            near = get_close_matches(name, self._names(), n=1, cutoff=0.7)
            meant = f"did you mean {near[0]}? See" if near else "see"
            raise UsageError(f"{name} is not an option; {meant} {self.prog} --help")

    def _names(self) -> list[str]:
        return [name for name in self._option_string_actions if name.startswith("--")]

    def _joined(self, words: list[str]) -> list[str]:
        """Words of which a value that begins with a minus is one with its option: `--at=-0.1,0.5`.

        argparse takes it for an option unless it is a plain number.
        """
        joined: list[str] = []
        for at, word in enumerate(words):
            before = words[at - 1] if at else ""
            action = self._option_string_actions.get(before)
            value = word.startswith("-") and not word.startswith("--") and word != "-"
            if (
                action is not None and action.nargs is None and before.startswith("--")
                and value and word not in self._option_string_actions
                and "--" not in words[:at]
            ):  # fmt: skip
                joined[-1] = f"{before}={word}"
            else:
                joined.append(word)
        return joined

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
    parser.add_argument("--version", action="version", version=f"nlens-video {VERSION}")
    parser.add_argument("-v", "--verbose", action="store_true", help="tell more; tracebacks")
    parser.add_argument("-q", "--quiet", action="store_true", help="errors only")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    return parser


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Whether what is there may be replaced."""
    parser.add_argument(
        "-y", "--overwrite", action="store_true", help="replace what is there without asking"
    )


def add_range(parser: Parser, meaning: str = "frames A to B-1, counted from 0") -> None:
    """How the plate is read, and which part of it."""
    part = add_source(parser).add_mutually_exclusive_group()
    part.add_argument("--range", metavar="A:B", type=_frames, default=(0, None), help=meaning)
    part.add_argument(
        "--frame", metavar="N", dest="range", type=_frame, default=(0, None),
        help="this frame only, which may become a picture",
    )  # fmt: skip


def add_plate(parser: Parser, meaning: str) -> None:
    """The plate by its name."""
    parser.add_argument("input", metavar="IN", type=plate_name, help=meaning)


def add_result(parser: Parser, meaning: str) -> None:
    """The result by its name."""
    parser.add_argument("output", metavar="OUT", type=result_name, help=meaning)


def add_source(parser: Parser) -> argparse._ArgumentGroup:
    """How the plate is read."""
    raw = parser.add_argument_group("the plate")
    raw.add_argument("--input-format", metavar="F", help="FFmpeg's name: rawvideo, lavfi, v4l2 …")
    raw.add_argument(
        "--input-size", metavar="WxH", type=_size, help="size of raw video, such as 960x512"
    )
    raw.add_argument(
        "--input-rate",
        metavar="FPS",
        help="frames a second of raw video and sequences, such as 25 or 30000/1001",
    )
    raw.add_argument(
        "--input-transfer", metavar="NAME", type=_transfer,
        help="take the plate's transfer to be srgb, bt709, linear …, where its tag is wrong",
    )  # fmt: skip
    return raw


def add_encoding(parser: Parser) -> None:
    """How the result is written."""
    out = parser.add_argument_group("the encoding (default: as the source)")
    out.add_argument("--codec", metavar="NAME", help="FFmpeg's encoder, such as libx264 or ffv1")
    out.add_argument(
        "--crf",
        metavar="Q",
        type=number,
        help="quality of encoders that have it: less is better",
    )
    out.add_argument("--pix-fmt", metavar="NAME", help="pixel format, such as yuv420p10le")
    out.add_argument("--keep-partial", action="store_true", help="keep what an interrupt leaves")


def _transfer(text: str) -> str:
    from nlens_video.core.color import TRANSFERS  # here: the help does without NumPy

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


def _frame(text: str) -> tuple[int, int]:
    if not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"{text!r} is not the number of a frame, from 0 on")
    return int(text), int(text) + 1


def number(text: str) -> float:
    """A number of usual size, from a word."""
    try:
        value = float(text)
    except ValueError:
        value = math.inf
    if not abs(value) <= _LARGEST:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of usual size")
    return value


def positive(text: str) -> float:
    """A number above 0, from a word."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 1.0 / _LARGEST <= value <= _LARGEST:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number of usual size")
    return value


def count(text: str) -> int:
    """A number from 1 on, from a word."""
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return int(text)


def word(text: str) -> str:
    """A name that is not empty, nor longer than a file's may be."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty; give a name")
    longest = max(len(os.fsencode(part)) for part in text.split("/"))
    if "://" not in text and longest > _LONGEST_NAME:
        raise argparse.ArgumentTypeError(
            f"is a name of {longest} bytes; a name has {_LONGEST_NAME} at most"
        )
    return text


def plate_name(text: str) -> str:
    """What is read: a file, a pattern, a device, an address, `-`."""
    return input_name(word(text))


def result_name(text: str) -> str:
    """What is written: a file, a pattern, an address, `-`."""
    return output_name(word(text))


def path(text: str) -> Path:
    """A file or a folder of this machine, from a word that is not empty.

    `Path` takes an empty word for the folder here, and an address for folders.
    """
    if "://" in text and not text.startswith("file:"):
        raise argparse.ArgumentTypeError(f"{text!r} is an address; give a file on this machine")
    return Path(word(text))


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    sides = [int(side) if side.isdecimal() and len(side) < 7 else 0 for side in (width, height)]
    if not all(sides):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, such as 960x512")
    return sides[0], sides[1]
