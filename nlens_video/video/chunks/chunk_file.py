"""Chunks of a longer result: lossless frames in NUT, at the plate's own times.

NUT keeps any time base exactly; Matroska rounds times to milliseconds. Decoders patch damaged
frames and say nothing, so each packet has a checksum behind the file's end.
"""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import av.container
import numpy as np
from av.video.stream import VideoStream

from nlens_video.core.errors import InputError, OutputError
from nlens_video.video.atomic_files import check_folder, partial_name, publish, remove_stale
from nlens_video.video.chunks.checksums import append_checksums, read_checksums
from nlens_video.video.chunks.chunk_codec import Carrier, carrier, no_carrier
from nlens_video.video.chunks.chunk_id import ChunkMark
from nlens_video.video.info import Packet, SourceFrame, SourceInfo
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.pixel_formats import layout
from nlens_video.video.pixels.sample_tables import Plane

_TAG = "NLENS_CHUNK"
_OPENING = {"fpsprobesize": "0"}  # no frames are decoded to guess a rate, which nobody asks for


class ChunkSink:
    """Writes a chunk; what travels beside the pictures is left to `merge`.

    Args:
        path: the file, which appears when it is complete.
        info: the plate.
        mark: where the chunk belongs.

    Attributes:
        notes: what was found of killed runs.
        kept: None; a part of a chunk is of no use.

    Raises:
        OutputError: it cannot be written there.
        UsageError: the plate's format has no lossless chunks.
    """

    def __init__(self, path: Path, info: SourceInfo, mark: ChunkMark) -> None:
        self.kept: Path | None = None
        self._path = path
        self._info = info
        self._stream: VideoStream | None = None
        self._checksums: list[int] = []
        check_folder(path)
        self.notes = remove_stale(path)
        self._partial = partial_name(path)
        with self._writing():
            self._container = av.open(f"file:{self._partial}", "w", format="nut")
        self._container.metadata[_TAG] = mark.to_json()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        with contextlib.suppress(av.FFmpegError, OSError, ValueError):
            self._container.close()
        with contextlib.suppress(OSError):
            self._partial.unlink(missing_ok=True)

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame at its own time.

        Raises:
            OutputError: the disk is full.
            UsageError: the plate's format has no lossless chunks.
        """
        chosen, carried = _carried(frame.picture)
        with self._writing():
            if self._stream is None:
                self._stream = self._opened(chosen, carried)
            carried.pts, carried.time_base = frame.pts, frame.time_base
            carried.pict_type = 0
            self._mux(self._stream, carried)

    def write_packet(self, packet: Packet) -> None:
        """Nothing: `merge` takes the other streams from the plate."""

    def commit(self) -> None:
        """Finish the file and give it its name.

        Raises:
            OutputError: it cannot be written.
        """
        with self._writing():
            if self._stream is not None:
                self._mux(self._stream, None)
            self._container.close()
            append_checksums(self._partial, self._checksums)
        publish(self._partial, self._path)

    def _mux(self, stream: VideoStream, frame: av.VideoFrame | None) -> None:
        for packet in stream.encode(frame):
            self._checksums.append(zlib.crc32(packet))
            self._container.mux(packet)

    def _opened(self, chosen: Carrier, first: av.VideoFrame) -> VideoStream:
        rate = self._info.average_rate or Fraction(25)
        stream = self._container.add_stream(chosen.codec, rate, dict(chosen.options))
        assert isinstance(stream, VideoStream)
        stream.width, stream.height = first.width, first.height
        stream.pix_fmt = first.format.name
        stream.time_base = stream.codec_context.time_base = self._info.time_base
        stream.codec_context.thread_type = "AUTO"
        return stream

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise OutputError(f"{self._path}: cannot be written ({reason})") from error


class ChunkFile:
    """A chunk that lies on the disk.

    Args:
        path: its file.

    Attributes:
        path: its file.
        mark: where it belongs.
        count: how many frames it holds [1].

    Raises:
        InputError: it cannot be read, is no chunk, or not a whole one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with av.open(f"file:{path}", "r", format="nut", options=_OPENING) as container:
                text = container.metadata.get(_TAG, "")
            self.mark = ChunkMark.from_json(text)
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it has no mark of one"
            raise InputError(
                f"{path}: is no chunk ({reason}); give what --as-chunk has written"
            ) from error
        try:
            self._checksums = read_checksums(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: is cut short; render it again") from error
        self.count = len(self._checksums)

    def frames(self) -> Iterator[av.VideoFrame]:
        """Its frames, in order.

        Raises:
            InputError: it is damaged.
        """
        try:
            with av.open(f"file:{self.path}", "r", format="nut", options=_OPENING) as container:
                stream = container.streams.video[0]
                stream.thread_type = "AUTO"
                packets = container.demux(stream)
                for checksum in self._checksums:  # and not on to the line behind the last packet
                    packet = next(packets)
                    if zlib.crc32(packet) != checksum:
                        raise ValueError("another checksum")
                    yield from packet.decode()
                for frame in stream.decode(None):
                    frame.time_base = stream.time_base or Fraction(0)  # flushed ones have none
                    yield frame
        except (av.FFmpegError, OSError, IndexError, ValueError, StopIteration) as error:
            raise InputError(f"{self.path}: is damaged; render it again") from error


def fill(picture: AvPicture, carried: av.VideoFrame) -> None:
    """Put a chunk's samples into the plate's picture that they were made from.

    Args:
        picture: of the plate; everything but its samples stays.
        carried: as `ChunkFile.frames` gives it.

    Raises:
        InputError: the two do not have one size and format.
    """
    frame = picture.frame
    name = frame.format.name
    if carried.format.is_rgb and carried.format.name != name and frame.format.is_rgb:
        carried = carried.reformat(format=name)  # only the order of the channels
    if (carried.width, carried.height, len(carried.planes)) != (
        frame.width, frame.height, len(frame.planes),
    ):  # fmt: skip
        raise InputError(
            f"a chunk's frame is {carried.width}x{carried.height} {carried.format.name}, the "
            f"plate's {frame.width}x{frame.height} {name}; render the chunk anew"
        )
    frame.make_writable()
    for target, samples in zip(_rows(frame), _rows(carried), strict=True):
        target[...] = samples


def _carried(picture: object) -> tuple[Carrier, av.VideoFrame]:
    """What carries a picture, and the samples as it takes them; the picture is left as it is."""
    if not isinstance(picture, AvPicture):
        raise no_carrier("OpenEXR")
    frame = picture.frame
    chosen = carrier(frame.format.name, frame.width, frame.height)
    if chosen.pixel_format == frame.format.name:
        return chosen, frame
    if not frame.format.name.startswith("yuvj"):
        return chosen, frame.reformat(format=chosen.pixel_format)
    bare = av.VideoFrame(frame.width, frame.height, chosen.pixel_format)
    for target, samples in zip(_rows(bare), _rows(frame), strict=True):
        target[...] = samples
    return chosen, bare


def _rows(frame: av.VideoFrame) -> list[Plane]:
    """Views of the samples of each plane, without what pads its rows."""
    kind = layout(frame.format.name)
    if kind is None:
        raise InputError(f"pixel format {frame.format.name} is not worked on; render it anew")
    views = []
    for plane in frame.planes:
        flat = np.frombuffer(memoryview(plane), np.dtype(kind.dtype))
        rows = flat.reshape(plane.height, plane.line_size // flat.itemsize)
        views.append(rows[:, : plane.width * kind.channels])
    return views
