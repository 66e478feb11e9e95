"""ICC profiles in the files of pictures: PNG, JPEG, TIFF and WebP."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

_LARGEST = 1 << 24  # of a profile [byte]
_PNG = b"\x89PNG\r\n\x1a\n"
_IN_JPEG = b"ICC_PROFILE\0"
_PART = 65519  # what of a profile fits into a segment of JPEG [byte]
_IN_TIFF = 34675
_START_OF_SCAN = 0xDA


def embedded_profile(data: bytes) -> bytes | None:
    """The ICC profile in a picture's file, None where there is none; empty for a damaged one.

    Args:
        data: the file.
    """
    try:
        if data.startswith(_PNG):
            return _from_png(data)
        if data.startswith(b"\xff\xd8"):
            return b"".join(_from_jpeg(data)) or None
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _from_tiff(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return next((part for name, part in _riff(data) if name == b"ICCP"), None)
    except (struct.error, zlib.error):
        return b""
    return None


def with_profile(jpeg: bytes, profile: bytes) -> bytes:
    """The file of a JPEG that has no profile, with one."""
    parts = [profile[start : start + _PART] for start in range(0, len(profile), _PART)]
    segments = (
        b"\xff\xe2" + struct.pack(">H", 16 + len(part)) + _IN_JPEG + bytes((number, len(parts)))
        + part
        for number, part in enumerate(parts, 1)
    )  # fmt: skip
    return jpeg[:2] + b"".join(segments) + jpeg[2:]


def png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and contents of the chunks before a PNG's picture; none in other files."""
    at = len(_PNG)
    while data.startswith(_PNG) and at + 8 <= len(data):
        length, name = struct.unpack_from(">I4s", data, at)
        if name == b"IDAT":
            return
        yield name, data[at + 8 : at + 8 + length]
        at += 12 + length


def _from_png(data: bytes) -> bytes | None:
    packed = next((part for name, part in png_chunks(data) if name == b"iCCP"), None)
    if packed is None:
        return None
    _, _, rest = packed.partition(b"\0")  # its name, and a byte for the kind of compression
    return zlib.decompressobj().decompress(rest[1:], _LARGEST)


def _from_jpeg(data: bytes) -> Iterator[bytes]:
    """The parts of a profile, in their order."""
    parts, at = {}, 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != _START_OF_SCAN:
        (length,) = struct.unpack_from(">H", data, at + 2)
        part = data[at + 4 : at + 2 + length]
        if data[at + 1] == 0xE2 and part.startswith(_IN_JPEG) and len(part) > 14:
            parts[part[12]] = part[14:]
        at += 2 + length
    return (parts[number] for number in sorted(parts))


def _from_tiff(data: bytes) -> bytes | None:
    order = "<" if data[:1] == b"I" else ">"
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, start)
    for index in range(count):
        tag, _, size, at = struct.unpack_from(f"{order}HHII", data, start + 2 + 12 * index)
        if tag == _IN_TIFF:
            return data[at : at + size]
    return None


def _riff(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 12
    while at + 8 <= len(data):
        name, size = struct.unpack_from("<4sI", data, at)
        yield name, data[at + 8 : at + 8 + size]
        at += 8 + size + size % 2
