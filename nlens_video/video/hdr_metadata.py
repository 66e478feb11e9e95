"""HDR metadata of pictures: the mastering display, light levels, dynamic metadata."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from fractions import Fraction

from av.sidedata.sidedata import Type
from msgspec import Struct

_DYNAMIC = {
    Type.DYNAMIC_HDR_PLUS: "HDR10+", Type.DYNAMIC_HDR_VIVID: "HDR Vivid",
    Type.DOVI_METADATA: "Dolby Vision", Type.DOVI_RPU_BUFFER: "Dolby Vision",
}  # fmt: skip
_MASTERING = struct.Struct("=22i")  # AVMasteringDisplayMetadata: ten rationals and two flags
_LIGHT = struct.Struct("=2I")  # AVContentLightMetadata


class MasteringDisplay(Struct, frozen=True, kw_only=True):
    """The display on which pictures were graded (SMPTE ST 2086).

    Attributes:
        red: CIE 1931 x and y [1].
        green: likewise.
        blue: likewise.
        white: likewise.
        luminance: least and greatest [cd/m²].
    """

    red: tuple[Fraction, Fraction]
    green: tuple[Fraction, Fraction]
    blue: tuple[Fraction, Fraction]
    white: tuple[Fraction, Fraction]
    luminance: tuple[Fraction, Fraction]


class HdrMetadata(Struct, frozen=True, kw_only=True):
    """What a frame says of its HDR.

    Attributes:
        mastering: the mastering display, None where it is not or not fully known.
        light: greatest light of a pixel and of a frame's mean, None where unknown [cd/m²].
        partial: whether there is a mastering display that is not fully known.
        dynamic: names of metadata that change from scene to scene.
    """

    mastering: MasteringDisplay | None = None
    light: tuple[int, int] | None = None
    partial: bool = False
    dynamic: tuple[str, ...] = ()


def hdr_metadata(data: Mapping[Type, bytes]) -> HdrMetadata:
    """The HDR metadata in the side data of a frame."""
    graded, level = Type.MASTERING_DISPLAY_METADATA, Type.CONTENT_LIGHT_LEVEL
    mastering = _mastering(bytes(data[graded])) if graded in data else None
    most, mean = _LIGHT.unpack_from(bytes(data[level])) if level in data else (0, 0)
    return HdrMetadata(
        mastering=mastering,
        light=(most, mean) if most or mean else None,  # 0 is unknown
        partial=graded in data and mastering is None,
        dynamic=tuple(sorted({name for kind, name in _DYNAMIC.items() if kind in data})),
    )


def _mastering(data: bytes) -> MasteringDisplay | None:
    *numbers, has_primaries, has_luminance = _MASTERING.unpack_from(data)
    if not (has_primaries and has_luminance and all(numbers[1::2])):
        return None
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y, least, most = (
        Fraction(*pair) for pair in pairs
    )
    return MasteringDisplay(
        red=(red_x, red_y), green=(green_x, green_y), blue=(blue_x, blue_y),
        white=(white_x, white_y), luminance=(least, most),
    )  # fmt: skip
