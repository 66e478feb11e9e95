"""Writes multi-channel OpenEXR."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from nlens_video.core.color import chromaticities
from nlens_video.core.errors import OutputError
from nlens_video.core.layers import Box, Float32
from nlens_video.video.atomic_files import replacing

Float16: TypeAlias = "NDArray[np.float16]"


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
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": (np.array([box.x0, box.y0], "i4"), np.array([box.x1 - 1, box.y1 - 1], "i4")),
        "displayWindow": (np.array([0, 0], "i4"), np.array([columns - 1, rows - 1], "i4")),
    }
    if primaries != "bt709":  # which a file without this means
        header["chromaticities"] = chromaticities(primaries)
    stored = _halved if half else partial(np.ascontiguousarray, dtype=np.float32)
    pixels = {name: stored(part) for name, part in channels.items()}
    with replacing(path) as unnamed:
        try:
            with OpenEXR.File(header, pixels) as file:
                file.write(str(unnamed))
        except (RuntimeError, ValueError) as error:
            raise OutputError(f"{path}: cannot be written ({first_line(error)})") from error


def _halved(values: Float32) -> Float16:
    """Values as half float; finite ones stay finite."""
    largest = np.finfo(np.float16).max
    clipped = np.where(np.isfinite(values), np.clip(values, -largest, largest), values)
    return np.ascontiguousarray(clipped, np.float16)


def first_line(error: Exception) -> str:
    """What an error says first."""
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
