"""Whether H.264 and HEVC are coded without loss, by their parameter sets."""

from __future__ import annotations

from collections.abc import Iterator

_HIGH_444, _CHROMA_444 = 244, 3
_H264_SPS, _HEVC_PPS = 7, 34
"""Types of NAL units."""


def is_lossless(codec: str, extradata: bytes) -> bool:
    """Whether a stream says that it may be coded without loss, which encoders say only if it is.

    Args:
        codec: FFmpeg's name of it.
        extradata: its header, as decoders take it.
    """
    try:
        for unit in _units(codec, extradata) if codec in ("h264", "hevc") else ():
            if codec == "h264" and unit[0] & 31 == _H264_SPS:
                return _bypasses_transform(unit)
            if codec == "hevc" and unit[0] >> 1 & 63 == _HEVC_PPS:
                return _allows_bypass(unit)
    except IndexError:  # it is cut short
        pass
    return False


def _bypasses_transform(sequence: bytes) -> bool:
    """`qpprime_y_zero_transform_bypass_flag` of a sequence parameter set."""
    if sequence[1] != _HIGH_444:
        return False
    bits = _Bits(sequence[4:])
    bits.number()  # of the set
    if bits.number() == _CHROMA_444:
        bits.take(1)
    bits.number()  # bits of luma
    bits.number()  # and of chroma
    return bool(bits.take(1))


def _allows_bypass(picture: bytes) -> bool:
    """`transquant_bypass_enabled_flag` of a picture parameter set."""
    bits = _Bits(picture[2:])
    bits.number()  # of the set
    bits.number()  # of the sequence's
    bits.take(1 + 1 + 3 + 1 + 1)
    for _ in range(3):  # references, quantiser
        bits.number()
    bits.take(1 + 1)
    if bits.take(1):  # quantisers differ within a picture
        bits.number()
    bits.number()  # offsets of chroma
    bits.number()
    bits.take(1 + 1 + 1)
    return bool(bits.take(1))


def _units(codec: str, extradata: bytes) -> Iterator[bytes]:
    """NAL units of a header: after start codes, or by the counts and lengths of MP4's records."""
    if extradata[:1] != b"\x01":
        yield from filter(None, extradata.split(b"\x00\x00\x01")[1:])
    elif codec == "h264":
        yield from _counted(extradata, 6, extradata[5] & 31)
    else:
        at = 23
        for _ in range(extradata[22]):
            units = list(_counted(extradata, at + 3, _pair(extradata, at + 1)))
            yield from units
            at += 3 + sum(2 + len(one) for one in units)


def _counted(extradata: bytes, at: int, count: int) -> Iterator[bytes]:
    for _ in range(count):
        length = _pair(extradata, at)
        yield extradata[at + 2 : at + 2 + length]
        at += 2 + length


def _pair(extradata: bytes, at: int) -> int:
    """A number of two bytes."""
    return extradata[at] << 8 | extradata[at + 1]


class _Bits:
    """Reads a NAL unit bit by bit; IndexError at its end."""

    def __init__(self, data: bytes) -> None:
        self._data = data.replace(b"\x00\x00\x03", b"\x00\x00")  # inserted where zeros follow
        self._at = 0

    def take(self, count: int) -> int:
        """An unsigned number of so many bits."""
        value = 0
        for _ in range(count):
            value = value << 1 | self._data[self._at >> 3] >> (7 - (self._at & 7)) & 1
            self._at += 1
        return value

    def number(self) -> int:
        """A number in Exp-Golomb code, signed ones as unsigned."""
        zeros = 0
        while not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)
