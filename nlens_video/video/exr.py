"""Multi-channel OpenEXR: pre-rendered object layers in, pictures and AOVs in and out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from nlens_video.core.errors import InputError, OutputError
from nlens_video.core.layers import MOST_PIXELS, Box, Float32, ObjectLayer, too_large
from nlens_video.video.atomic_files import replacing
from nlens_video.video.numbered import ImageSequence

FAR = 1e9
"""Depths from here on mean that nothing is there; renderers write 1e10 or so [scene unit]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExrImage:
    """The channels of one file.

    Attributes:
        channels: name to samples (h, w), float32, on the data window.
        box: the data window relative to the display window's corner.
        width: columns of the display window [px].
        height: rows of the display window [px].
    """

    channels: dict[str, Float32]
    box: Box
    width: int
    height: int


def read_exr(path: Path) -> ExrImage:
    """Read every channel of the first part of a file.

    Raises:
        InputError: the file is missing, is no OpenEXR file, or is larger than `MOST_PIXELS`, or
            channels are subsampled.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected an OpenEXR file")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header: dict[str, Any] = dict(file.header())  # emptied on closing
        for window in ("dataWindow", "displayWindow"):
            _check_size(path, header[window])
        with OpenEXR.File(str(path), separate_channels=True) as file:
            pixels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as error:
        raise InputError(f"{path}: cannot be read as OpenEXR ({_first_line(error)})") from error
    (x0, y0), (x1, y1) = (np.asarray(corner) for corner in header["dataWindow"])
    (left, top), (right, bottom) = (np.asarray(corner) for corner in header["displayWindow"])
    box = Box(int(x0 - left), int(y0 - top), int(x1 - left) + 1, int(y1 - top) + 1)
    channels = {}
    for name, samples in pixels.items():
        if samples.shape != (box.height, box.width):
            raise InputError(f"{path}: channel {name} is subsampled; write it at full resolution")
        channels[name] = np.ascontiguousarray(samples, dtype=np.float32)
    return ExrImage(
        channels=channels, box=box, width=int(right - left) + 1, height=int(bottom - top) + 1
    )


def _check_size(path: Path, window: tuple[Any, Any]) -> None:
    (x0, y0), (x1, y1) = ((int(x), int(y)) for x, y in window)
    width, height = x1 - x0 + 1, y1 - y0 + 1
    if width * height > MOST_PIXELS:
        raise InputError(too_large(str(path), width, height))


def read_layer(path: Path, size: tuple[int, int] | None = None) -> ObjectLayer:
    """Read a pre-rendered object layer.

    Args:
        path: file with R, G, B, A (scene-linear, premultiplied) and Z (camera-space depth).
        size: width and height that the display window must have; None: any [px].

    Raises:
        InputError: not OpenEXR, channels missing, values that are not finite, another size.
    """
    image = read_exr(path)
    missing = [name for name in "RGBAZ" if name not in image.channels]
    if missing:
        raise InputError(
            f"{path}: channels {' '.join(missing)} are missing (has "
            f"{' '.join(sorted(image.channels))}); a layer needs R G B A and Z"
        )
    if size is not None and (image.width, image.height) != size:
        raise InputError(
            f"{path}: {image.width}x{image.height} pixels, the plate has {size[0]}x{size[1]}; "
            "render the layers at the plate's size"
        )
    rgba = np.stack([image.channels[name] for name in "RGBA"], axis=2)
    if not np.isfinite(rgba).all():
        raise InputError(f"{path}: R G B A hold values that are not finite; render them again")
    depth = image.channels["Z"]
    with np.errstate(invalid="ignore"):
        there = (depth > 0.0) & (depth < FAR)
    return ObjectLayer(box=image.box, rgba=rgba, depth=np.where(there, depth, np.float32(np.inf)))


class LayerReader:
    """Object layers frame by frame: one file for all, or a `%04d` sequence.

    Args:
        spec: a file, or a pattern whose smallest number on disk is frame 0.
        size: width and height of the plate [px].

    Raises:
        InputError: no file fits.
    """

    def __init__(self, spec: str, size: tuple[int, int]) -> None:
        self._size = size
        self._single = None if ImageSequence.matches(spec) else Path(spec)
        self._files = ImageSequence(spec)
        self._first = 0 if self._single else self._files.first()

    def read(self, index: int) -> ObjectLayer:
        """The layer of a frame.

        Raises:
            InputError: the sequence has ended, or the file is unusable.
        """
        if self._single is not None:
            return read_layer(self._single, self._size)
        path = self._files.path(self._first + index)
        if not path.is_file():
            raise InputError(
                f"{path}: the layers end before frame {index} of the plate; "
                "render more of them or give --range"
            )
        return read_layer(path, self._size)


def write_layers(
    path: Path, channels: Mapping[str, Float32], box: Box | None = None,
    size: tuple[int, int] | None = None,
) -> None:  # fmt: skip
    """Write channels as 32-bit float OpenEXR, ZIP compressed; the file appears when it is complete.

    Args:
        path: of the file.
        channels: name (`R`, `Z`, `coc.plate`, ...) to samples (h, w), all of one shape.
        box: where they lie in the frame; default: the frame is as large as they are.
        size: width and height of the frame [px].

    Raises:
        OutputError: it cannot be written.
    """
    height, width = next(iter(channels.values())).shape
    box = box or Box(0, 0, width, height)
    columns, rows = size or (box.x1, box.y1)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": (np.array([box.x0, box.y0], "i4"), np.array([box.x1 - 1, box.y1 - 1], "i4")),
        "displayWindow": (np.array([0, 0], "i4"), np.array([columns - 1, rows - 1], "i4")),
    }
    pixels = {name: np.ascontiguousarray(part, np.float32) for name, part in channels.items()}
    with replacing(path) as partial:
        try:
            with OpenEXR.File(header, pixels) as file:
                file.write(str(partial))
        except (RuntimeError, ValueError) as error:
            raise OutputError(f"{path}: cannot be written ({_first_line(error)})") from error


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
