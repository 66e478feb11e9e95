"""What a recording says of its camera: tags of the file, of its picture (EXIF), of its track.

FFmpeg gives the file's tags and a picture's EXIF, but not the tags of a QuickTime track, where
phones write the focal length; those are read here.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import av
import av.container
import av.video.stream

_LARGEST = 1 << 20  # of a box of tags: larger ones hold something else [byte]
_MOST_BOXES = 4096
_TEXT, _INTEGERS, _REALS = 1, (21, 22), {23: ">f", 24: ">d"}  # QuickTime's types of values


def camera_tags(
    spec: str,
    container: av.container.InputContainer,
    stream: av.video.stream.VideoStream,
    first: av.VideoFrame,
) -> dict[str, str]:
    """Tags of the file, of the stream, of the first picture and of the QuickTime tracks.

    Args:
        spec: name of the source.
        container: of the source.
        stream: the one that is composited on.
        first: its first frame.
    """
    tags = {**container.metadata, **stream.metadata, **first.metadata}
    if "mov" in container.format.name.split(",") and Path(spec).is_file():
        tags = {**tags, **track_tags(Path(spec))}
    return tags


def track_tags(path: Path) -> dict[str, str]:
    """Tags of the tracks of a QuickTime file, none where it is damaged.

    They lie in `moov/trak/meta`: `keys` names them, `ilst` holds the values.
    """
    tags: dict[str, str] = {}
    try:
        with path.open("rb") as file:
            end = path.stat().st_size
            for _, start, stop in _boxes(file, 0, end, b"moov"):
                for _, inner, last in _boxes(file, start, stop, b"trak"):
                    for _, first, after in _boxes(file, inner, last, b"meta"):
                        if after - first <= _LARGEST:
                            file.seek(first)
                            tags |= _keyed(file.read(after - first))
    except (OSError, struct.error, IndexError):
        return {}
    return tags


def _boxes(file: BinaryIO, start: int, end: int, kind: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Boxes of a kind between two offsets: kind, and where their content starts and ends."""
    for _ in range(_MOST_BOXES):
        if start + 8 > end:
            return
        file.seek(start)
        size, found = struct.unpack(">I4s", file.read(8))
        head = 8
        if size == 1:
            (size,) = struct.unpack(">Q", file.read(8))
            head = 16
        stop = start + size if size else end
        if size and size < head or stop > end:
            return
        if found == kind:
            yield found, start + head, stop
        start = stop


def _keyed(data: bytes) -> dict[str, str]:
    """The tags of a `meta` box."""
    inside = {kind: part for kind, part in _parts(data)}
    if not inside:
        inside = {kind: part for kind, part in _parts(data[4:])}  # ISO's box has a version first
    listed, values = inside.get(b"keys", b""), inside.get(b"ilst", b"")
    names = [name.decode("utf-8", "replace") for _, name in _parts(listed[8:])]
    tags = {}
    for number, item in _parts(values):
        at = int.from_bytes(number, "big") - 1
        for kind, value in _parts(item):
            text = _text(value) if kind == b"data" else None
            if text is not None and 0 <= at < len(names):
                tags[names[at]] = text
    return tags


def _parts(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The boxes in a stretch of bytes."""
    start = 0
    while start + 8 <= len(data):
        size, kind = struct.unpack(">I4s", data[start : start + 8])
        if size < 8 or start + size > len(data):
            return
        yield kind, data[start + 8 : start + size]
        start += size


def _text(value: bytes) -> str | None:
    """A value as text, None for one that is neither text nor a number, or is malformed."""
    kind, content = int.from_bytes(value[:4], "big"), value[8:]
    if kind == _TEXT:
        return content.decode("utf-8", "replace")
    if kind in _INTEGERS:
        return str(int.from_bytes(content, "big", signed=kind == _INTEGERS[0]))
    if kind in _REALS and len(content) == struct.calcsize(_REALS[kind]):
        return f"{struct.unpack(_REALS[kind], content)[0]:g}"
    return None
