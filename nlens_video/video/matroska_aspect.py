"""The shape of pixels in Matroska and WebM files, written into their headers afterwards.

FFmpeg's muxer takes it from a field of the stream that PyAV does not set, not from the encoder.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

CONTAINERS = ("matroska", "webm")
"""FFmpeg's muxers of these files."""
_SEGMENT, _TRACKS, _CLUSTER = 0x18538067, 0x1654AE6B, 0x1F43B675
_CRC, _ENTRY, _VIDEO, _VOID = 0xBF, 0xAE, 0xE0, 0xEC
_DISPLAY_WIDTH, _DISPLAY_HEIGHT, _DISPLAY_UNIT = 0x54B0, 0x54BA, 0x54B2
_DIGITS = 8
"""Most bytes of a length [1]."""
_HEADER = 1 << 20
"""Bytes that surely hold the tracks, which come before the pictures [1]."""


class _Element(NamedTuple):
    """An element of EBML, with the places of its parts in the bytes that were read."""

    name: int
    start: int
    content: int
    end: int


def write_display_size(path: Path, size: tuple[int, int], ratio: Fraction) -> bool:
    """Say in a file's header how large its pictures are shown; all else stays where it is.

    Args:
        path: a finished file of FFmpeg's muxer, whose first track is the pictures.
        size: width and height of the pictures [px].
        ratio: width of a pixel by its height [1].

    Returns:
        Whether there was room for it.

    Raises:
        OSError: the file cannot be read or written.
    """
    with path.open("rb+") as file:
        data = file.read(_HEADER)
        tracks = _tracks(data)
        if tracks is None:
            return False
        entry = next((one for one in _elements(data, tracks) if one.name == _ENTRY), None)
        if entry is None:
            return False
        tried = (_with_display(data, entry, shown) for shown in _shown_sizes(size, ratio))
        made = next((one for one in tried if one is not None), None)
        if made is None:
            return False
        changed = data[: entry.start] + made + data[entry.end :]
        checksum = next(_elements(changed, tracks))
        content = changed[tracks.content : tracks.end]
        if checksum.name == _CRC:
            rest = changed[checksum.end : tracks.end]
            sum_ = zlib.crc32(rest).to_bytes(4, "little")
            content = changed[tracks.content : checksum.content] + sum_ + rest
        file.seek(tracks.content)
        file.write(content)
    return True


def _shown_sizes(size: tuple[int, int], ratio: Fraction) -> Iterator[dict[int, int]]:
    """Sizes of elements that say how large pictures are shown, the most exact first [px].

    Without a height it is that of the pictures.
    """
    width, height = size
    shown = width * ratio
    shape = shown / height
    scale = round(height / shape.denominator)
    if shown.denominator > 1 and scale:
        yield {
            _DISPLAY_WIDTH: shape.numerator * scale, _DISPLAY_HEIGHT: shape.denominator * scale,
        }  # fmt: skip
    yield {_DISPLAY_WIDTH: max(1, round(shown))}


def _with_display(data: bytes, entry: _Element, shown: dict[int, int]) -> bytes | None:
    """A track's entry of the same length with another display size, None without room.

    FFmpeg writes the entry's length in eight bytes, of which fewer do, and empty space. The unit is
    left to its default, pixels.
    """
    parts = []
    for one in _elements(data, entry):
        part = b"" if one.name == _VOID else data[one.start : one.end]
        if one.name == _VIDEO:
            kept = b"".join(
                data[inner.start : inner.end] for inner in _elements(data, one)
                if inner.name not in (_DISPLAY_WIDTH, _DISPLAY_HEIGHT, _DISPLAY_UNIT)
            )  # fmt: skip
            for name, value in shown.items():
                number = value.to_bytes((value.bit_length() + 7) // 8, "big")
                kept += _named(name, number, 1)
            part = _named(_VIDEO, kept, 1 if len(kept) < 127 else 2)
        parts.append(part)
    content = b"".join(parts)
    digits = entry.end - entry.start - 1 - len(content)
    if digits > _DIGITS:
        empty = max(2, digits - _DIGITS)
        content += _named(_VOID, bytes(empty - 2), 1)
        digits -= empty
    if not 1 <= digits <= _DIGITS or len(content) >= (1 << 7 * digits) - 1:
        return None
    return _named(_ENTRY, content, digits)


def _named(name: int, content: bytes, digits: int) -> bytes:
    """An element whose length is written in so many bytes."""
    length = (len(content) | 1 << 7 * digits).to_bytes(digits, "big")
    return name.to_bytes((name.bit_length() + 7) // 8, "big") + length + content


def _tracks(data: bytes) -> _Element | None:
    whole = _Element(0, 0, 0, len(data))
    segment = next((one for one in _elements(data, whole) if one.name == _SEGMENT), None)
    if segment is None:
        return None
    for one in _elements(data, segment):
        if one.name == _TRACKS and one.end <= len(data):
            return one
        if one.name == _CLUSTER:
            break
    return None


def _elements(data: bytes, parent: _Element) -> Iterator[_Element]:
    """The elements within another one, as far as they begin within the bytes that were read."""
    at = parent.content
    while at < min(parent.end, len(data) - 12):
        digits = 9 - data[at].bit_length()
        name = int.from_bytes(data[at : at + digits], "big")
        length_at = at + digits
        digits = 9 - data[length_at].bit_length()
        length = int.from_bytes(data[length_at : length_at + digits], "big")
        length &= (1 << 7 * digits) - 1
        unknown = length == (1 << 7 * digits) - 1
        content = length_at + digits
        end = len(data) if unknown else content + length
        yield _Element(name, at, content, end)
        at = end
