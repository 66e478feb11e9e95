"""Readers of option values: text from the command line to a checked value.

Each raises `argparse.ArgumentTypeError` with what came and what is expected.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Callable
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.core.known_lens import KnownLens, parse_lens
from nlens_video.core.placement import Region
from nlens_video.core.settings import NO_SUN, SunSettings, TrackFocus
from nlens_video.video.named_files import exists, input_name, local_path, output_name

_LARGEST = 1e9
"""Numbers beyond it are typing errors, and overflow somewhere."""
_TURN_DEG, _UPRIGHT_DEG, _STRONGEST_SUN = 360.0, 90.0, 100.0
_HASHES = re.compile("#{2,}")
_VIDEOS = {
    "", ".3gp", ".apng", ".asf", ".avi", ".flv", ".gif", ".m2ts", ".m4v", ".mj2", ".mkv", ".mov",
    ".mp4", ".mpeg", ".mpg", ".mts", ".mxf", ".nut", ".ogv", ".ts", ".vob", ".webm", ".wmv", ".y4m",
}  # fmt: skip
"""Extensions of files that hold a whole video, none of its numbered pictures."""
_LONGEST_NAME = 255  # of a file or folder on Linux and macOS [byte]


def between(low: float, high: float, expected: str) -> Callable[[str], float]:
    """A reader of numbers in [low, high].

    Args:
        low: the least one.
        high: the greatest one.
        expected: what the value must be, for the message.
    """

    def read(text: str) -> float:
        value = _float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not {expected}")
        return value

    return read


number = between(-_LARGEST, _LARGEST, "a number from -1e9 to 1e9")
positive = between(1.0 / _LARGEST, _LARGEST, "a positive number, 1e-9 to 1e9")


def count(text: str) -> int:
    """A whole number from 1 on."""
    if not (text.isdecimal() and len(text) < 10 and int(text)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return int(text)


def port(text: str) -> int:
    """A port of this machine, 0 for a free one."""
    if not (text.isdecimal() and len(text) < 6 and int(text) < 1 << 16):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, 1 to 65535, or 0 for a free one")
    return int(text)


def word(text: str) -> str:
    """A name: not empty, without NUL, no part of it longer than the name of a file may be."""
    if not text.strip():
        raise argparse.ArgumentTypeError("is empty; give a name")
    if "\0" in text:
        raise argparse.ArgumentTypeError("has a NUL character; no name has one")
    longest = max(len(os.fsencode(part)) for part in text.split("/"))
    if "://" not in text and longest > _LONGEST_NAME:
        raise argparse.ArgumentTypeError(
            f"is a name of {longest} bytes; a name has {_LONGEST_NAME} at most"
        )
    return text


def pattern(text: str) -> str:
    """A file, or numbered files: `p.%04d.png`, or `p.####.png` as Nuke, RV and Houdini have it.

    A single `#` stands for one digit in one of them, for four in another, and is left as it is, as
    are those in the name of a video.
    """
    folder, slash, name = word(text).rpartition("/")
    runs = _HASHES.findall(name)
    if len(runs) != 1 or "%" in name or "://" in text or exists(Path(text)):
        return text
    if Path(name).suffix.lower() in _VIDEOS:
        return text
    return f"{folder}{slash}{name.replace(runs[0], f'%0{len(runs[0])}d')}"


def plate_name(text: str) -> str:
    """Name of a source: a file, a pattern, a device, a URL, `-`."""
    return input_name(pattern(text))


def result_name(text: str) -> str:
    """Name of a result: a file, a pattern, a URL, `-`."""
    return output_name(pattern(text))


def path(text: str) -> Path:
    """A file or a folder on this machine, not a standard stream.

    `Path("")` would be the current folder, and `Path("http://…")` a tree of folders.
    """
    if "://" in text and not text.startswith("file:"):
        raise argparse.ArgumentTypeError(f"{text!r} is an address; give a file on this machine")
    if text == "-":
        raise argparse.ArgumentTypeError(
            "'-' is a standard stream; give a file (./- has that name)"
        )
    return Path(word(text))


def input_path(text: str) -> Path:
    """A file or a folder that is read more than once: not a pipe or a device."""
    return Path(_not_a_pipe(str(path(text))))


def input_pattern(text: str) -> str:
    """As `pattern`, of files that are read more than once: not a pipe or a device."""
    return _not_a_pipe(pattern(text))


def _not_a_pipe(name: str) -> str:
    file = local_path(name)
    if file is not None and exists(file) and not file.is_file() and not file.is_dir():
        raise argparse.ArgumentTypeError(f"{name!r} is a pipe or a device; give a file")
    return name


def light_around(text: str) -> Path | None:
    """A map of the surroundings; None for `plate`, which estimates them."""
    return None if text == "plate" else input_path(text)


def sun(text: str) -> SunSettings:
    """A sun from `AZ,EL` or `AZ,EL,STRENGTH`; no sun from `none`."""
    if text == "none":
        return NO_SUN
    values = [_float(part) for part in text.split(",")]
    if (
        len(values) not in (2, 3)
        or not abs(values[0]) <= _TURN_DEG
        or not 0.0 < values[1] <= _UPRIGHT_DEG
        or not 0.0 < (values[2] if values[2:] else 1.0) <= _STRONGEST_SUN
    ):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not none, AZ,EL or AZ,EL,STRENGTH, such as 60,35 (from the right of "
            "where the camera looks, 35 degrees up; above 0 to 90) or 60,35,3 (up to 100)"
        )
    strength = values[2] if values[2:] else None
    return SunSettings(azimuth_deg=values[0], elevation_deg=values[1], strength=strength)


def point(text: str) -> tuple[float, float]:
    """X,Y; `core.placement.Placement` checks their range."""
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y, such as 0.5,0.8") from None
    return x, y


def lens(text: str) -> KnownLens:
    """Such as `50mm f/2.8 focus 2.4m sensor full-frame`, or any part of it."""
    try:
        return parse_lens(text)
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def region(text: str) -> Region:
    """X0,Y0,X1,Y1 of a box, or X,Y of each corner of a polygon; fractions of the frame."""
    try:
        return Region.of([_float(part) for part in text.split(",")])
    except UsageError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not X0,Y0,X1,Y1 or X,Y,X,Y,X,Y… ({error})"
        ) from None


def segments(text: str) -> tuple[float, ...]:
    """X0,Y0,X1,Y1 of the ends of a line segment, or of several; fractions of the frame."""
    values = tuple(_float(part) for part in text.split(","))
    if len(values) % 4 or not all(-1.0 <= value <= 2.0 for value in values):
        raise argparse.ArgumentTypeError(
            f"{text[:60]!r} is not X0,Y0,X1,Y1 of the ends of each line, fractions of the frame"
        )
    return values


_UNITS_M = {"mm": 0.001, "cm": 0.01, "m": 1.0, "": 1.0}


def length(text: str) -> float:
    """A length in metres: `0.4`, `0.4m`, `40cm`, `400mm`."""
    digits = text.rstrip("cm")
    value = _float(digits) * _UNITS_M.get(text[len(digits) :], math.nan)
    if not 1e-4 <= value <= 1e4:
        raise argparse.ArgumentTypeError(f"{text!r} is not a length, such as 0.4m or 40cm")
    return value


def person(text: str) -> tuple[float, ...]:
    """X,Y in the frame, or X0,Y0,X1,Y1 with X0 < X1 and Y0 < Y1; fractions of the frame."""
    values = [_float(part) for part in text.split(",")]
    if len(values) == 2 and all(0.0 <= value <= 1.0 for value in values):
        return tuple(values)
    if len(values) == 4:
        left, upper, right, lower = values
        if -1.0 <= left < right <= 2.0 and -1.0 <= upper < lower <= 2.0:
            return left, upper, right, lower
    raise argparse.ArgumentTypeError(
        f"{text!r} is not X,Y or X0,Y0,X1,Y1 in fractions of the frame, such as 0.45,0.5 or "
        "0.4,0.2,0.5,0.9"
    )


def distortion(text: str) -> tuple[float, float]:
    """K1 or K1,K2: radial coefficients."""
    values = [_float(part) for part in text.split(",")]
    if len(values) > 2 or not all(abs(value) <= 10.0 for value in values):
        raise argparse.ArgumentTypeError(f"{text!r} is not K1 or K1,K2, such as -0.12,0.01")
    return values[0], values[1] if len(values) == 2 else 0.0


def track_focus(text: str) -> TrackFocus:
    """`auto`, `off` or every so many frames."""
    if text == "auto":
        return "auto"
    if text == "off":
        return "off"
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"{text!r} is not auto, off or a number of frames")
    return int(text)


def transfer(text: str) -> str:
    """FFmpeg's name of a transfer function, or `srgb`."""
    from nlens_video.core.color import TRANSFERS  # here: the help does without NumPy

    names = {**{name: name for name in TRANSFERS.values()}, "srgb": "iec61966-2-1"}
    if text not in names:
        raise argparse.ArgumentTypeError(f"'{text}': expected one of {', '.join(sorted(names))}")
    return names[text]


def frame_range(text: str) -> tuple[int, int | None]:
    """A:B, with 0 <= A < B; either may be left out."""
    first, colon, end = text.partition(":")
    try:
        frames = (int(first or 0), int(end) if end else None)
    except ValueError:
        colon = ""
    if not colon or frames[0] < 0 or (frames[1] is not None and frames[1] <= frames[0]):
        raise argparse.ArgumentTypeError(f"{text!r} is not A:B with 0 <= A < B")
    return frames


def frame_index(text: str) -> int:
    """A frame, counted from 0."""
    return one_frame(text)[0]


def one_frame(text: str) -> tuple[int, int]:
    """N, as the range N:N+1."""
    if not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"{text!r} is not the number of a frame, from 0 on")
    return int(text), int(text) + 1


def frame_size(text: str) -> tuple[int, int]:
    """WIDTHxHEIGHT [px]."""
    width, _, height = text.partition("x")
    sides = [int(side) if side.isdecimal() and len(side) < 7 else 0 for side in (width, height)]
    if not all(sides):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, such as 960x512")
    return sides[0], sides[1]


def _float(text: str) -> float:
    """The number, or NaN, which no comparison accepts."""
    try:
        return float(text)
    except ValueError:
        return math.nan
