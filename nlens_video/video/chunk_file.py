"""Files of chunks: lossless frames in NUT, at the plate's own times.

NUT stores any time base exactly; Matroska rounds times to milliseconds. Decoders conceal damaged
frames silently, so each packet has a checksum, in a line behind the container's last packet.
"""

from __future__ import annotations

import contextlib
import json
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import NamedTuple

import av
import av.container
from av.video.stream import VideoStream

from nlens_video.core.errors import InputError, OutputError, UsageError
from nlens_video.video.atomic_files import check_folder, partial_name, publish, remove_stale
from nlens_video.video.chunk_queue import ChunkFeed, ChunkMark
from nlens_video.video.info import Packet, SourceFrame, SourceInfo
from nlens_video.video.interfaces import Sink
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.pixel_formats import layout
from nlens_video.video.pixels.samples import Plane, plane_rows

_TAG = "NLENS_CHUNK"
_OPENING = {"fpsprobesize": "0"}  # decode no frames to estimate a rate, which nothing here needs
_LEAST_SLICED_PX = 64  # smaller pictures are encoded in one slice
_PACKED_RGB = {(8, False): "rgb24", (8, True): "bgra", (16, False): "rgb48le"}
_CHECKSUMS = b"NLENSCRC"  # NUT takes an N for a header, does not know this one, and skips it
_LENGTH = 16  # size of the line's length, in decimals, at the end of the file [byte]


class Carrier(NamedTuple):
    """A lossless encoding: FFmpeg's encoder, its input pixel format, its options."""

    codec: str
    pixel_format: str
    options: dict[str, str]


def carrier(pixel_format: str, width: int, height: int) -> Carrier:
    """The fastest encoding that preserves all samples of a format.

    Args:
        pixel_format: a working format, FFmpeg's name.
        width: columns as stored [px].
        height: rows as stored [px].

    Raises:
        UsageError: there is none.
    """
    kind = layout(pixel_format)
    if kind is not None and kind.family != "float":
        # full range is a tag, the samples are the same
        bare = f"yuv{pixel_format[4:]}" if pixel_format.startswith("yuvj") else pixel_format
        packed = _PACKED_RGB.get((kind.bits, kind.alpha)) if kind.family == "rgb" else None
        for name in filter(None, (bare, packed)):
            # ffvhuff silently cuts chroma that does not fit, and refuses it in slices
            fits = width % kind.step_x == 0 == height % kind.step_y
            if fits and name in _accepted("ffvhuff"):
                return Carrier("ffvhuff", name, {"pred": "plane"})
            if name in _accepted("ffv1"):
                slices = "4" if fits and min(width, height) >= _LEAST_SLICED_PX else "1"
                return Carrier("ffv1", name, {"level": "3", "g": "1", "slices": slices})
    raise _no_carrier(pixel_format)


@cache
def _accepted(codec: str) -> set[str]:
    """Pixel formats that an encoder accepts."""
    return {one.name for one in av.Codec(codec, "w").video_formats or ()}


def _no_carrier(kind: str) -> UsageError:
    return UsageError(
        f"a plate in {kind} has no lossless chunks; render ranges of it straight into a sequence "
        "such as out_%06d.exr, whose files keep their numbers"
    )


class ChunkWriter(Sink):
    """Writes the chunks of a queue, one after the other; complete ones survive an aborted run.

    Args:
        folder: where the files appear.
        info: the plate.
        feed: the queue; its `done` is called with each complete chunk.
    """

    def __init__(self, folder: Path, info: SourceInfo, feed: ChunkFeed) -> None:
        self._folder = folder
        self._info = info
        self._feed = feed
        self._mark: ChunkMark | None = None  # of the chunk that is open

    def close(self) -> None:
        """Discard the chunk that is not complete."""
        if self._mark is not None:
            with contextlib.suppress(av.FFmpegError, OSError, ValueError):
                self._container.close()
            with contextlib.suppress(OSError):
                self._partial.unlink(missing_ok=True)

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame into its chunk, at its own time.

        Raises:
            OutputError: the disk is full, or the file cannot be written there.
            UsageError: the plate's format has no lossless encoding.
        """
        chosen, carried = _carried(frame.picture)
        mark = self._mark or self._begin(chosen, carried)
        with self._writing():
            carried.pts, carried.time_base = frame.pts, frame.time_base
            carried.pict_type = 0
            self._encode(carried)
        if mark.end is not None and frame.index + 1 >= mark.end:
            self.commit()

    def write_packet(self, packet: Packet) -> None:
        """Nothing: `merge` copies the other streams from the plate."""

    def commit(self) -> None:
        """Finish the current chunk and rename it to its final name.

        Raises:
            OutputError: it cannot be written.
        """
        if self._mark is None:
            return
        with self._writing():
            self._encode(None)
            self._container.close()
            line = json.dumps(self._checksums).encode()
            with self._partial.open("ab") as file:
                file.write(_CHECKSUMS + line + str(len(line)).rjust(_LENGTH).encode())
        publish(self._partial, self._path)
        mark, self._mark = self._mark, None
        self._feed.done(mark)

    def _begin(self, chosen: Carrier, first: av.VideoFrame) -> ChunkMark:
        mark = self._feed.begun.popleft()
        self._path = self._folder / mark.file_name
        check_folder(self._path)
        self._notes += remove_stale(self._path)
        self._partial = partial_name(self._path)
        self._checksums: list[int] = []
        with self._writing():
            self._container = av.open(f"file:{self._partial}", "w", format="nut")
            self._mark = mark
            self._container.metadata[_TAG] = mark.to_json()
            rate = self._info.average_rate or 25
            stream = self._container.add_stream(chosen.codec, rate, chosen.options)
            assert isinstance(stream, VideoStream)
            stream.width, stream.height = first.width, first.height
            stream.pix_fmt = first.format.name
            stream.time_base = stream.codec_context.time_base = self._info.time_base
            stream.codec_context.thread_type = "AUTO"
            self._stream = stream
        return mark

    def _encode(self, frame: av.VideoFrame | None) -> None:
        for packet in self._stream.encode(frame):
            self._checksums.append(zlib.crc32(packet))
            self._container.mux(packet)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise OutputError(f"{self._path}: cannot be written ({reason})") from error


class ChunkFile:
    """A complete chunk on the disk.

    Attributes:
        path: its file.
        mark: its identity.
        count: number of frames [1].

    Raises:
        InputError: the file cannot be read, is no chunk, or is truncated.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with av.open(f"file:{path}", "r", format="nut", options=_OPENING) as container:
                text = container.metadata.get(_TAG, "")
            self.mark = ChunkMark.from_json(text)
        except (av.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it has no mark of one"
            advice = "give what --chunk-out has written"
            raise InputError(f"{path}: is no chunk ({reason}); {advice}") from error
        try:
            self._checksums = _read_checksums(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: is cut short; render it again") from error
        self.count = len(self._checksums)

    def frames(self) -> Iterator[av.VideoFrame]:
        """Decode the frames in order.

        Raises:
            InputError: a packet is damaged.
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


def _read_checksums(path: Path) -> list[int]:
    """Checksums of the packets; ValueError where the file has none."""
    with path.open("rb") as file:
        end = max(0, file.seek(0, 2) - _LENGTH)
        file.seek(end)
        length = int(file.read(_LENGTH))
        start = end - length - len(_CHECKSUMS)
        if length < 0 or start < 0:
            raise ValueError("no checksums")
        file.seek(start)
        text = file.read(len(_CHECKSUMS) + length)
    found = json.loads(text.removeprefix(_CHECKSUMS)) if text.startswith(_CHECKSUMS) else None
    if not isinstance(found, list) or not all(type(one) is int for one in found):
        raise ValueError("no checksums")
    return found


def fill(picture: AvPicture, carried: av.VideoFrame) -> None:
    """Copy a chunk's samples into the plate's picture that they were made from.

    Args:
        picture: of the plate; everything but its samples stays.
        carried: from `ChunkFile.frames`.

    Raises:
        InputError: sizes or formats differ.
    """
    frame, name = picture.frame, picture.frame.format.name
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
    _copy_samples(frame, carried)


def _carried(picture: object) -> tuple[Carrier, av.VideoFrame]:
    """The encoding of a picture, and its samples in that format; the picture is unchanged."""
    if not isinstance(picture, AvPicture):
        raise _no_carrier("OpenEXR")
    frame, name = picture.frame, picture.frame.format.name
    chosen = carrier(name, frame.width, frame.height)
    if chosen.pixel_format == name:
        return chosen, frame
    if not name.startswith("yuvj"):
        return chosen, frame.reformat(format=chosen.pixel_format)
    bare = av.VideoFrame(frame.width, frame.height, chosen.pixel_format)
    _copy_samples(bare, frame)
    return chosen, bare


def _copy_samples(target: av.VideoFrame, source: av.VideoFrame) -> None:
    for rows, samples in zip(_planes(target), _planes(source), strict=True):
        rows[...] = samples


def _planes(frame: av.VideoFrame) -> list[Plane]:
    kind = layout(frame.format.name)
    if kind is None:
        raise InputError(f"pixel format {frame.format.name} is not worked on; render it anew")
    return [plane_rows(plane, kind) for plane in frame.planes]
