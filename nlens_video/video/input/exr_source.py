"""OpenEXR plates: scene-linear stills and sequences."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from nlens_video.core.color import ColorTags
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import Box
from nlens_video.video.exr import read_exr
from nlens_video.video.info import Packet, SourceFrame, SourceInfo
from nlens_video.video.input.open import DEFAULT_RATE
from nlens_video.video.numbered import ImageSequence
from nlens_video.video.pixels.picture import ArrayPicture

MOST_UNREADABLE = 8
"""Files of a sequence in a row after which it counts as ended."""
LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)


class ExrSource:
    """Frames of one OpenEXR file or a `%04d` sequence of them.

    Attributes:
        info: what is known about the source.
        damaged: files of the sequence that could not be read so far, the first not among them.
        packet_sink: never called, there is nothing beside the pictures.
    """

    def __init__(self, spec: str, rate: str | None) -> None:
        self.damaged = 0
        self.packet_sink: Callable[[Packet], None] | None = None
        self._pattern = ImageSequence(spec) if ImageSequence.matches(spec) else None
        numbers = self._pattern.span() if self._pattern else range(1)
        self._start, count = numbers.start, len(numbers)
        self._path = Path(spec)
        try:
            fps = Fraction(rate or DEFAULT_RATE)
        except (ValueError, ZeroDivisionError) as error:
            raise UsageError(f"--input-rate {rate}: expected a number such as 25") from error
        self._ended_early: tuple[str, ...] = ()
        first = _picture(self._file(0))
        self.info = SourceInfo(
            name=spec, kind="sequence" if self._pattern else "still", width=first.width,
            height=first.height, time_base=1 / fps, average_rate=fps, frame_count=count,
            duration_s=float(count / fps), pixel_format="gbrpf32le", tags=LINEAR, codec="exr",
        )  # fmt: skip

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        """Nothing is held open between frames."""

    def __iter__(self) -> Iterator[SourceFrame]:
        info = self.info
        lost = in_a_row = 0
        for number in range(info.frame_count or 0):
            try:
                picture = _picture(self._file(number))
            except InputError:
                self.damaged += 1
                lost += 1
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
                index=number - lost, pts=number, time_base=info.time_base,
                time_s=float(number * info.time_base), duration=1, picture=picture, lost=lost,
            )  # fmt: skip

    def warnings(self) -> tuple[str, ...]:
        """What happened so far that a person should know, beside the damaged files."""
        return self._ended_early

    def _file(self, index: int) -> Path:
        return self._pattern.path(self._start + index) if self._pattern else self._path


def _picture(path: Path) -> ArrayPicture:
    """The RGB, or Y, of a file on its display window; black where the data window has nothing."""
    image = read_exr(path)
    names: list[str] = [name for name in ("R", "G", "B", "A") if name in image.channels]
    if names[:3] != ["R", "G", "B"]:
        names = ["Y", "Y", "Y"] if "Y" in image.channels else []
    if not names:
        raise InputError(
            f"{path}: has no R, G, B (found {' '.join(sorted(image.channels))}); expected a picture"
        )
    frame = Box(0, 0, image.width, image.height)
    shown = image.box.intersection(frame)
    array = np.zeros((image.height, image.width, len(names)), np.float32)
    if not shown.empty:
        pixels = np.stack([image.channels[name] for name in names], axis=2)
        array[shown.slices_in(frame)] = pixels[shown.slices_in(image.box)]
    return ArrayPicture(array, "rgb", LINEAR, associated=len(names) == 4)
