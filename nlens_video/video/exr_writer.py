"""Writes multi-channel OpenEXR: new files, and a plate's file with another picture."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from nlens_video.core.color import chromaticities
from nlens_video.core.errors import InputError, OutputError
from nlens_video.core.layers import Box, Float32
from nlens_video.video.atomic_files import replacing
from nlens_video.video.named_files import is_utf8

Float16: TypeAlias = "npt.NDArray[np.float16]"
Header: TypeAlias = "dict[str, Any]"
Stored: TypeAlias = "dict[str, npt.NDArray[Any]]"
_OF_THE_FILE = (
    "channels", "chunkCount", "dataWindow", "lineOrder", "maxSamplesPerPixel", "name", "preview",
    "tiles", "type", "version",
)  # fmt: skip
"""Attributes that hold for a file as it was written, or show its former picture."""


def write_layers(
    path: Path, channels: Mapping[str, Float32], box: Box | None = None,
    size: tuple[int, int] | None = None, *, half: bool = False, primaries: str = "bt709",
) -> None:  # fmt: skip
    """Write channels as OpenEXR, ZIP compressed; the file appears when it is complete.

    Args:
        path: of the file.
        channels: name (`R`, `Z`, `coc.plate`, ...) to samples (h, w), all of one shape.
        box: where they lie in the frame; default: the frame is as large as they are.
        size: width and height of the frame [px].
        half: as half float, whose largest stands for what is larger; default: float of 32 bits.
        primaries: of R, G and B, by a name of `ColorTags`.

    Raises:
        OutputError: it cannot be written.
    """
    import OpenEXR

    height, width = next(iter(channels.values())).shape
    box = box or Box(0, 0, width, height)
    columns, rows = size or (box.x1, box.y1)
    header: Header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "dataWindow": _window(box), "displayWindow": _window(Box(0, 0, columns, rows)),
    }  # fmt: skip
    if primaries != "bt709":  # which a file without this means
        header["chromaticities"] = chromaticities(primaries)
    _write(path, header, _stored(channels, half=half))


def write_over(
    path: Path, channels: Mapping[str, Float32], plate: Path, *, half: bool = False
) -> None:
    """Write a plate's file with another picture; the file appears when it is complete.

    Attributes, compression, further channels in their own types, and what lies outside the display
    window stay, but for what `not_carried` names.

    Args:
        path: of the new file.
        channels: R, G, B, and A where the plate has it, on its display window.
        plate: an OpenEXR file.
        half: whether the picture is stored as half float.

    Raises:
        InputError: the plate's file cannot be read any more.
        OutputError: the new one cannot be written.
    """
    header, *_ = _read(plate, pixels=False)
    held, shown = (_box(header[name]) for name in ("dataWindow", "displayWindow"))
    whole = held.union(shown)
    names = {channel.name for channel in header["channels"]}
    grey = "R" not in names  # it is written in colour
    further = names - {*channels, *("Y" if grey else "")}
    own = _read(plate)[1] if further or whole != shown else {}
    if grey and own:
        own |= dict.fromkeys("RGB", own.pop("Y"))
    picture = _stored(channels, half=half)
    pixels = {}
    for name, samples in (own | picture).items():
        pixels[name] = np.zeros((whole.height, whole.width), samples.dtype)
        if name in own:
            pixels[name][held.slices_in(whole)] = own[name]
        if name in picture:
            pixels[name][shown.slices_in(whole)] = picture[name]
    kept = {name: value for name, value in header.items() if name not in _OF_THE_FILE}
    _write(path, {**kept, "dataWindow": _window(whole)}, pixels)


def not_carried(plate: Path) -> tuple[str, ...]:
    """What of a plate's file `write_over` leaves out, for the user.

    Raises:
        InputError: it cannot be read.
    """
    *_, parts = _read(plate, pixels=False)
    words = f"the first of {parts} parts is kept: the picture is taken from it"
    return (words,) if parts > 1 else ()


def _read(plate: Path, *, pixels: bool = True) -> tuple[Header, Stored, int]:
    """Header and samples of the first part of a file, and the number of its parts."""
    import OpenEXR

    try:
        with OpenEXR.File(str(plate), separate_channels=True, header_only=not pixels) as file:
            header = dict(file.header())  # emptied on closing
            own = file.channels() if pixels else {}
            samples = {name: channel.pixels for name, channel in own.items()}
            return header, samples, len(file.parts)
    except (RuntimeError, ValueError, OSError) as error:
        raise InputError(f"{plate}: cannot be read as OpenEXR ({first_line(error)})") from error


def _write(path: Path, header: Header, pixels: Stored) -> None:
    import OpenEXR

    if not is_utf8(path):
        raise OutputError(f"{path.name}: OpenEXR takes names in UTF-8 alone; give another")
    header = {**header, "type": OpenEXR.scanlineimage}
    with replacing(path) as unnamed:
        try:
            with OpenEXR.File(header, pixels) as file:
                file.write(str(unnamed))
        except (RuntimeError, ValueError) as error:
            raise OutputError(f"{path}: cannot be written ({first_line(error)})") from error


def _box(window: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]) -> Box:
    (x0, y0), (x1, y1) = window
    return Box(int(x0), int(y0), int(x1) + 1, int(y1) + 1)


def _window(box: Box) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    return np.array([box.x0, box.y0], "i4"), np.array([box.x1 - 1, box.y1 - 1], "i4")


def _stored(channels: Mapping[str, Float32], *, half: bool) -> Stored:
    kind = _halved if half else partial(np.ascontiguousarray, dtype=np.float32)
    return {name: kind(part) for name, part in channels.items()}


def _halved(values: Float32) -> Float16:
    """Values as half float; finite ones stay finite."""
    largest = np.finfo(np.float16).max
    clipped = np.where(np.isfinite(values), np.clip(values, -largest, largest), values)
    return np.ascontiguousarray(clipped, np.float16)


def first_line(error: Exception) -> str:
    """What an error says first."""
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
