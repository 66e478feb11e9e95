"""Multi-channel OpenEXR: plates, object layers and AOVs."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.color import ColorTags, primaries_at, primaries_from_bt709
from nlens_video.core.errors import InputError, Note, NoteKind, UsageError
from nlens_video.core.layers import MOST_PIXELS, Box, Float32, ObjectLayer, too_large
from nlens_video.video.exr_writer import first_line, not_carried, write_layers, write_over
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.interfaces import Source
from nlens_video.video.named_files import DEFAULT_RATE, ImageSequence, is_utf8
from nlens_video.video.pixels.picture import ArrayPicture

__all__ = [
    "ExrImage", "ExrSource", "LayerReader", "not_carried", "read_exr", "read_layer",
    "write_layers", "write_over",
]  # fmt: skip
FAR = 1e9
"""Depths from here on are background; renderers write about 1e10 [scene unit]."""
_ROUNDED = 0.01  # alpha that filters leave beyond 0 to 1 and nobody need know of [1]
MOST_UNREADABLE = 8
"""Unreadable files of a sequence in a row after which it counts as ended."""
LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)


class ExrImage(Struct, frozen=True, kw_only=True):
    """The channels of one file.

    Attributes:
        channels: name to samples (h, w), float32, on the data window.
        box: the data window relative to the display window's corner.
        width: columns of the display window [px].
        height: rows of the display window [px].
        half: names of the channels that are stored as half float.
        primaries: of R, G and B, by a name of `ColorTags`; None for those that have none.
    """

    channels: dict[str, Float32]
    box: Box
    width: int
    height: int
    half: frozenset[str] = frozenset()
    primaries: str | None = "bt709"

    def in_bt709(self, light: Float32) -> Float32:
        """Light (h, w, 3) of its primaries in those of BT.709, for which unknown ones are taken."""
        if self.primaries in (None, "bt709"):
            return light
        from_own = np.linalg.inv(primaries_from_bt709(self.primaries)).astype(np.float32)
        return np.asarray(light @ from_own.T, dtype=np.float32)

    def on_display_window(self, values: Float32, beyond: float = 0.0) -> Float32:
        """Values (h, w) or (h, w, n) of the data window, padded and cropped to the display window.

        Args:
            values: of the data window.
            beyond: padding.
        """
        frame = Box(0, 0, self.width, self.height)
        shown = self.box.intersection(frame)
        out = np.full((self.height, self.width, *values.shape[2:]), beyond, np.float32)
        if not shown.empty:
            out[shown.slices_in(frame)] = values[shown.slices_in(self.box)]
        return out


def read_exr(path: Path) -> ExrImage:
    """Read every channel of the first part of a file.

    Raises:
        InputError: the file is missing, is no OpenEXR file, or is larger than `MOST_PIXELS`, or
            channels are subsampled.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected an OpenEXR file")
    if not is_utf8(path):
        raise InputError(f"{path}: OpenEXR takes names in UTF-8 alone; rename it")
    import OpenEXR  # here: it takes long to load, and few runs need it

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            header: dict[str, Any] = dict(file.header())  # emptied on closing
        for window in ("dataWindow", "displayWindow"):
            _check_size(path, header[window])
        with OpenEXR.File(str(path), separate_channels=True) as file:
            pixels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as error:
        raise InputError(f"{path}: cannot be read as OpenEXR ({first_line(error)})") from error
    (x0, y0), (x1, y1) = (np.asarray(corner) for corner in header["dataWindow"])
    (left, top), (right, bottom) = (np.asarray(corner) for corner in header["displayWindow"])
    box = Box(int(x0 - left), int(y0 - top), int(x1 - left) + 1, int(y1 - top) + 1)
    channels = {}
    for name, samples in pixels.items():
        if samples.shape != (box.height, box.width):
            raise InputError(f"{path}: channel {name} is subsampled; write it at full resolution")
        channels[name] = np.ascontiguousarray(samples, dtype=np.float32)
    half = frozenset(name for name, samples in pixels.items() if samples.dtype == np.float16)
    width, height = int(right - left) + 1, int(bottom - top) + 1
    told = header.get("chromaticities")  # those of BT.709 where there are none, as OpenEXR has it
    return ExrImage(
        channels=channels, box=box, width=width, height=height, half=half,
        primaries="bt709" if told is None else primaries_at(told),
    )  # fmt: skip


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
    return _read_layer(path, size)[0]


def _read_layer(path: Path, size: tuple[int, int] | None) -> tuple[ObjectLayer, tuple[Note, ...]]:
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
    rgba[..., :3] = image.in_bt709(rgba[..., :3])
    notes = _doubts(path, image)
    # a renderer's sharpening filter leaves the range: more than all of the plate would be hidden
    np.clip(rgba[..., 3], 0.0, 1.0, out=rgba[..., 3])
    depth = image.channels["Z"]
    with np.errstate(invalid="ignore"):
        there = (depth > 0.0) & (depth < FAR)
    depth = np.where(there, depth, np.float32(np.inf))
    return ObjectLayer(box=image.box, rgba=rgba, depth=depth), notes


def _doubts(path: Path, image: ExrImage) -> tuple[Note, ...]:
    """What is odd about a layer, for the user."""
    least, most = (float(end) for end in (image.channels["A"].min(), image.channels["A"].max()))
    line = f"{path}: alpha from {least:.3g} to {most:.3g} is cut to 0 to 1; render it as coverage"
    beyond = least < -_ROUNDED or most > 1.0 + _ROUNDED
    return (*((Note(line, NoteKind.UNCERTAIN),) if beyond else ()), *_odd_primaries(path, image))


def _odd_primaries(path: Path, image: ExrImage) -> tuple[Note, ...]:
    line = f"{path}: primaries that are not known are taken for those of BT.709"
    return () if image.primaries else (Note(line, NoteKind.UNCERTAIN),)


class LayerReader:
    """Object layers of the frames: one file for all, or a `%04d` sequence.

    Args:
        spec: a file, or a pattern whose smallest number on disk is frame 0.
        size: width and height of the plate [px].

    Raises:
        InputError: no file fits the pattern.
    """

    def __init__(self, spec: str, size: tuple[int, int]) -> None:
        self._size = size
        self._path = Path(spec)
        self._files = ImageSequence.of_input(spec)
        self._first = self._files.first() if self._files else 0
        self._notes: tuple[Note, ...] = ()

    @property
    def notes(self) -> tuple[Note, ...]:
        """What is odd about the first layer that is odd, for the user."""
        return self._notes

    def read(self, index: int) -> ObjectLayer:
        """The layer of a frame.

        Raises:
            InputError: the sequence has ended, or the file is unusable.
        """
        path = self._files.path(self._first + index) if self._files else self._path
        if self._files and not path.is_file():
            raise InputError(
                f"{path}: the layers end before frame {index} of the plate; "
                "render more of them or give --range"
            )
        layer, notes = _read_layer(path, self._size)
        self._notes = self._notes or notes
        return layer


class ExrSource(Source):
    """Scene-linear plates: one OpenEXR file or a `%04d` sequence.

    Args:
        spec: a file or a pattern.
        rate: frames per second, None for `DEFAULT_RATE`.

    Raises:
        InputError: a file is missing, or the first one is unusable.
        UsageError: the rate is no number.
    """

    def __init__(self, spec: str, rate: str | None) -> None:
        self._pattern = ImageSequence.of_input(spec)
        numbers = self._pattern.span() if self._pattern else range(1)
        self._start, count = numbers.start, len(numbers)
        self._path = Path(spec)
        try:
            fps = Fraction(rate or DEFAULT_RATE)
        except (ValueError, ZeroDivisionError) as error:
            raise UsageError(f"--input-rate {rate}: expected a number such as 25") from error
        self._ended_early: tuple[str, ...] = ()
        image = read_exr(self._file(0))
        first = _picture(image, self._file(0))
        self.info = SourceInfo(
            name=spec, kind="sequence" if self._pattern else "still", width=first.width,
            height=first.height, time_base=1 / fps, average_rate=fps, frame_count=count,
            duration_s=float(count / fps), pixel_format="gbrpf32le", tags=first.tags, codec="exr",
            half=image.half.issuperset(_names(image)), notes=_odd_primaries(self._file(0), image),
        )  # fmt: skip

    def close(self) -> None:
        """Nothing: no file stays open between frames."""

    def __iter__(self) -> Iterator[SourceFrame]:
        info = self.info
        in_a_row = 0
        for number in range(info.frame_count or 0):
            try:
                picture = _picture(read_exr(self._file(number)), self._file(number))
            except InputError:
                self._damaged += 1
                in_a_row += 1
                if in_a_row == MOST_UNREADABLE:
                    self._ended_early = (f"given up after {in_a_row} unreadable files in a row",)
                    return
                continue
            in_a_row = 0
            if (picture.width, picture.height) != (info.width, info.height):
                raise InputError(
                    f"{self._file(number)}: {picture.width}x{picture.height} pixels, the first "
                    f"file has {info.width}x{info.height}; make them one size first"
                )
            yield SourceFrame(
                index=number - self._damaged, pts=number, time_base=info.time_base,
                time_s=float(number * info.time_base), duration=1, picture=picture,
                lost=self._damaged,
            )  # fmt: skip

    def warnings(self) -> tuple[str, ...]:
        """Irregularities so far, other than unreadable files."""
        return self._ended_early

    def _file(self, index: int) -> Path:
        return self._pattern.path(self._start + index) if self._pattern else self._path


def _names(image: ExrImage) -> list[str]:
    """The channels of a picture: RGB or Y, and alpha beside RGB; none where there is none."""
    names = [name for name in "RGBA" if name in image.channels]
    return names if names[:3] == list("RGB") else [name for name in "Y" if name in image.channels]


def _picture(image: ExrImage, path: Path) -> ArrayPicture:
    """The RGB, or Y, of a file on its display window; black outside the data window."""
    names = _names(image)
    if not names:
        raise InputError(
            f"{path}: has no R, G, B (found {' '.join(sorted(image.channels))}); expected a picture"
        )
    shown = names * 3 if names == ["Y"] else names
    array = image.on_display_window(np.stack([image.channels[name] for name in shown], axis=2))
    tags = replace(LINEAR, primaries=image.primaries or LINEAR.primaries)
    return ArrayPicture(array, "rgb", tags, associated=len(names) == 4)
