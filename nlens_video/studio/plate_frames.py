"""Frames of a plate by their number: decoded on demand, the last ones kept, large ones reduced."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import Picture
from nlens_video.core.settings import SourceSettings
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.open import (
    InputHints,
    can_be_read_again,
    open_container,
    video_stream,
)
from nlens_video.video.input.packet_index import stated_frames
from nlens_video.video.input.seek import SeekableSource, open_seekable
from nlens_video.video.interfaces import Source
from nlens_video.video.named_files import local_path
from nlens_video.video.pixels.blend import is_shown_as_coded
from nlens_video.video.pixels.picture import SRGB, ArrayPicture, AvPicture

_KEPT_BYTES = 128 << 20
_BYTES_A_PIXEL = 6  # at most: three samples of 16 bit
_UNSEEN = ("vp8",)  # codecs some of whose packets show no frame


class PlateFrames:
    """A plate's frames; any thread may ask, one is served at a time.

    Args:
        source: the plate, a file or numbered files.
        most_px: pixels of a frame above which it is reduced [px].

    Attributes:
        info: of the plate.
        size: columns and rows of the frames as they are given [px].

    Raises:
        UsageError: the plate is a stream.
        InputError: it cannot be read.
    """

    def __init__(self, source: SourceSettings, most_px: float = math.inf) -> None:
        place = local_path(source.spec)
        missing = place is not None and not place.exists()  # which opening it says
        if not can_be_read_again(source.spec) and not missing:
            raise UsageError(f"{source.spec}: the studio needs a plate in files, not a stream")
        self._source = source
        self._lock = threading.Lock()
        self._open: Source = open_seekable(source.spec, **source.hints)
        self._frames: Iterator[SourceFrame] = iter(self._open)
        self._next = 0
        self._count: int | None = None
        self._kept: OrderedDict[int, SourceFrame] = OrderedDict()
        self.info = self._open.info
        wide, high = self.info.width, self.info.height
        scale = min(1.0, math.sqrt(most_px / (wide * high)))
        self.size = max(1, round(wide * scale)), max(1, round(high * scale))
        self._most = max(4, _KEPT_BYTES // (_BYTES_A_PIXEL * self.size[0] * self.size[1]))

    @property
    def reduced(self) -> bool:
        """Whether the frames are given smaller than they are."""
        return self.size != (self.info.width, self.info.height)

    def count(self) -> int:
        """Frames of the plate [1]: by its header or its packets where these tell, else read.

        A duration does not tell: in Matroska it is that of the longest stream.
        """
        if self._count is None:
            self._count = self._counted()
        return self._count

    def frame(self, index: int) -> SourceFrame:
        """A frame, which others may share: copy its picture before compositing.

        Args:
            index: of the frame in the plate, from 0.

        Raises:
            InputError: the plate cannot be read, or has no such frame.
        """
        with self._lock:
            if index not in self._kept:
                self._read(index)
            if index not in self._kept:
                raise InputError(f"{self.info.name}: has no frame {index}")
            self._kept.move_to_end(index)
            return self._kept[index]

    def first(self, start: int, count: int) -> tuple[SourceFrame, ...]:
        """Up to `count` frames from `start` on."""
        found = []
        for index in range(start, start + count):
            try:
                found.append(self.frame(index))
            except InputError:
                if not found:
                    raise
                break
        return tuple(found)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._kept.clear()
            self._open.close()

    def _counted(self) -> int:
        if self.info.kind == "still":
            return 1
        count = self.info.frame_count if self.info.kind == "sequence" else self._packets()
        if count:
            return count
        with open_seekable(self._source.spec, **self._source.hints) as source:
            return sum(1 for _ in source)

    def _packets(self) -> int | None:
        """Frames by the header, else packets from the first key frame on.

        None where a frame may have none or several of its own, or where not all can be read.
        """
        import av

        given = self._source.hints
        hints = InputHints(
            format=given.get("input_format"), size=given.get("input_size"),
            rate=given.get("input_rate"), transfer=given.get("input_transfer"),
        )  # fmt: skip
        container, _ = open_container(self._source.spec, hints)
        with container:
            stream = video_stream(container, self._source.spec)
            stated = stated_frames(container, stream)
            if stated:
                return stated
            if self.info.interlaced or stream.codec.name in _UNSEEN:
                return None
            count = 0
            try:
                for packet in container.demux(stream):
                    count += bool(packet.size) and (count > 0 or packet.is_keyframe)
            except av.FFmpegError:
                return None
            return count

    def _reopen(self) -> None:
        self._open.close()
        self._open = open_seekable(self._source.spec, **self._source.hints)
        self._frames = iter(self._open)
        self._next = 0

    def _read(self, index: int) -> None:
        if index < self._next:
            self._reopen()
        if isinstance(self._open, SeekableSource):
            self._open.skip_to(index)
        for frame in self._frames:
            self._next = frame.index + 1
            if frame.index < index - self._most:
                continue
            self._kept[frame.index] = replace(frame, picture=self._reduced(frame.picture))
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
            if frame.index >= index:
                return

    def _reduced(self, picture: Picture) -> Picture:
        if not self.reduced or not isinstance(picture, AvPicture | ArrayPicture):
            return picture
        curve = picture.tags.transfer
        small = cv2.resize(picture.shown(), self.size, interpolation=cv2.INTER_AREA)
        deep = np.round(small[..., ::-1].clip(0.0, 1.0) * 65535.0).astype(np.uint16)
        tags = replace(SRGB, transfer=curve) if is_shown_as_coded(curve) else SRGB
        return ArrayPicture(np.ascontiguousarray(deep), tags=tags)


def to_jpeg(picture: Picture, quality: int = 90) -> bytes:
    """A picture as the browser takes it."""
    levels = np.round(picture.shown().clip(0.0, 1.0) * 255.0)
    return levels_to_jpeg(levels.astype(np.uint8), quality)


def levels_to_jpeg(levels: npt.NDArray[np.uint8], quality: int = 90) -> bytes:
    """A picture (H, W, 3), sRGB, as the browser takes it."""
    done, data = cv2.imencode(".jpg", levels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise InputError(f"a picture of {levels.shape} cannot be written as a JPEG")
    return data.tobytes()
