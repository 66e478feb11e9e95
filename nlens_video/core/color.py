"""Colour: transfer functions, YUV matrices, primaries and ranges, picked from FFmpeg's tags.

Rendered light is scene-linear with BT.709 primaries; 1.0 is diffuse white, which PQ puts at 203
nits and HLG at a signal of 75 % (ITU-R BT.2408). Codes below black are mirrored (`-f(-x)`), codes
above white follow the curve on, so that nothing a stream can hold is lost on the way and back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from msgspec import Struct

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64

Family = Literal["yuv", "rgb", "gray", "float"]

# FFmpeg's numbers (libavutil/pixfmt.h) and names, which are those of ITU-T H.273.
MATRICES = {
    0: "gbr", 1: "bt709", 4: "fcc", 5: "bt470bg", 6: "smpte170m", 7: "smpte240m", 9: "bt2020nc",
}  # fmt: skip
TRANSFERS = {
    1: "bt709", 4: "gamma22", 5: "gamma28", 6: "smpte170m", 7: "smpte240m", 8: "linear",
    11: "bt709", 12: "bt709",  # xvYCC and BT.1361, which differ from it outside [0, 1] only
    13: "iec61966-2-1", 14: "bt2020-10", 15: "bt2020-12", 16: "smpte2084", 18: "arib-std-b67",
}  # fmt: skip
PRIMARIES = {
    1: "bt709", 4: "bt470m", 5: "bt470bg", 6: "smpte170m", 7: "smpte240m", 8: "film", 9: "bt2020",
    11: "smpte431", 12: "smpte432", 22: "ebu3213",
}  # fmt: skip
_UNSPECIFIED = (0, 2, 3)
"""Numbers that say nothing: reserved ones and unspecified; 0 is a matrix of RGB too."""
_NOT_SUPPORTED = {
    "matrix": {
        8: "ycgco", 10: "bt2020c", 11: "smpte2085", 12: "chroma-derived-nc",
        13: "chroma-derived-c", 14: "ictcp", 15: "ipt-c2", 16: "ycgco-re", 17: "ycgco-ro",
    },
    "transfer": {9: "log100", 10: "log316", 17: "smpte428"},
    "primaries": {10: "smpte428"},
}  # fmt: skip
_WIDE = [("matrix", tag) for tag in (10, 12, 13, 14, 15)]  # of BT.2020's primaries
FULL_RANGE = 2
"""FFmpeg's `AVCOL_RANGE_JPEG`; 1 is limited, 0 unspecified."""

_LUMA = {
    "bt709": (0.2126, 0.0722),
    "fcc": (0.30, 0.11),
    "bt470bg": (0.299, 0.114),
    "smpte170m": (0.299, 0.114),
    "smpte240m": (0.212, 0.087),
    "bt2020nc": (0.2627, 0.0593),
}
# Chromaticities of red, green, blue and white (ITU-T H.273, table 2).
_D65 = (0.3127, 0.3290)
_CHROMATICITY = {
    "bt709": ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060), _D65),
    "bt470m": ((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), (0.310, 0.316)),
    "bt470bg": ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), _D65),
    "smpte170m": ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65),
    "smpte240m": ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65),
    "film": ((0.681, 0.319), (0.243, 0.692), (0.145, 0.049), (0.310, 0.316)),
    "bt2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _D65),
    "smpte431": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.314, 0.351)),
    "smpte432": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65),
    "ebu3213": ((0.630, 0.340), (0.295, 0.605), (0.155, 0.077), _D65),
    # ACES (SMPTE ST 2065-1, and S-2014-004 for ACEScg), of which no stream's tag tells
    "ap0": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770), (0.32168, 0.33767)),
    "ap1": ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), (0.32168, 0.33767)),
}
_SAME_XY = 2e-3  # files round their chromaticities
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
# SMPTE ST 2084, and nits of diffuse white by ITU-R BT.2408.
_PQ_M1, _PQ_M2 = 2610 / 16384, 2523 / 4096 * 128
_PQ_C1, _PQ_C2, _PQ_C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_PQ_SCALE = 10000.0 / 203.0
# ARIB STD-B67.
_HLG_A, _HLG_B, _HLG_C = 0.17883277, 0.28466892, 0.55991073
_HLG_WHITE = (np.exp((0.75 - _HLG_C) / _HLG_A) + _HLG_B) / 12.0


class Transfer(Struct, frozen=True):
    """A transfer function and its inverse, odd about zero, increasing.

    Attributes:
        name: FFmpeg's name.
        decode: code value in [0, inf), 1.0 = nominal peak, to scene-linear light.
        encode: scene-linear light in [0, inf) to a code value.
    """

    name: str
    decode: Callable[[Float64], Float64]
    encode: Callable[[Float64], Float64]

    def to_linear(self, coded: Float64) -> Float64:
        """Scene-linear light of code values of any sign, 1.0 = diffuse white."""
        values = np.asarray(coded, dtype=np.float64)
        return np.asarray(np.copysign(self.decode(np.abs(values)), values))

    def to_coded(self, linear: Float64) -> Float64:
        """Code values of scene-linear light of any sign."""
        values = np.asarray(linear, dtype=np.float64)
        return np.asarray(np.copysign(self.encode(np.abs(values)), values))


def _power(name: str, gamma: float) -> Transfer:
    return Transfer(name, lambda v: v**gamma, lambda v: v ** (1.0 / gamma))


def _offset_power(name: str, alpha: float, slope: float, knee: float, gamma: float) -> Transfer:
    """The family of BT.709 and sRGB: `slope * l` below `knee`, `alpha * l**gamma - (alpha - 1)`."""

    def decode(v: Float64) -> Float64:
        power = ((v + (alpha - 1.0)) / alpha) ** (1.0 / gamma)
        return np.where(v < slope * knee, v / slope, power)

    def encode(v: Float64) -> Float64:
        return np.where(v < knee, v * slope, alpha * v**gamma - (alpha - 1.0))

    return Transfer(name, decode, encode)


def _pq_decode(v: Float64) -> Float64:
    root = np.minimum(v, 1.5) ** (1.0 / _PQ_M2)  # the curve has a pole at 1.99
    light = np.maximum(root - _PQ_C1, 0.0) / (_PQ_C2 - _PQ_C3 * root)
    return np.asarray(_PQ_SCALE * light ** (1.0 / _PQ_M1))


def _pq_encode(v: Float64) -> Float64:
    root = (v / _PQ_SCALE) ** _PQ_M1
    return np.asarray(((_PQ_C1 + _PQ_C2 * root) / (1.0 + _PQ_C3 * root)) ** _PQ_M2)


def _hlg_decode(v: Float64) -> Float64:
    bright = (np.exp((np.minimum(v, 4.0) - _HLG_C) / _HLG_A) + _HLG_B) / 12.0
    light = np.where(v <= 0.5, v * v / 3.0, bright)
    return np.asarray(light / _HLG_WHITE)


def _hlg_encode(v: Float64) -> Float64:
    light = v * _HLG_WHITE
    bright = _HLG_A * np.log(np.maximum(12.0 * light - _HLG_B, 0.5)) + _HLG_C
    return np.asarray(np.where(light <= 1.0 / 12.0, np.sqrt(3.0 * light), bright))


# The unrounded constants with which the two branches of each curve meet.
_BT709 = (1.099296826809442, 4.5, 0.018053968510807, 0.45)
_CURVES = {
    **{
        name: _offset_power(name, *_BT709)
        for name in ("bt709", "smpte170m", "bt2020-10", "bt2020-12")
    },
    "smpte240m": _offset_power("smpte240m", 1.111572195921731, 4.0, 0.022821585529445, 0.45),
    "iec61966-2-1": _offset_power("iec61966-2-1", 1.055, 12.92, 0.0031308, 1.0 / 2.4),
    "gamma22": _power("gamma22", 2.2),
    "gamma28": _power("gamma28", 2.8),
    "linear": Transfer("linear", lambda v: v, lambda v: v),
    "smpte2084": Transfer("smpte2084", _pq_decode, _pq_encode),
    "arib-std-b67": Transfer("arib-std-b67", _hlg_decode, _hlg_encode),
}


def transfer(name: str) -> Transfer:
    """The transfer function of one of FFmpeg's names in `TRANSFERS`."""
    return _CURVES[name]


def rgb_from_yuv(matrix: str) -> Float64:
    """Matrix (3, 3) from Y in [0, 1] and Cb, Cr in [-0.5, 0.5] to RGB in [0, 1]."""
    kr, kb = _LUMA[matrix]
    kg = 1.0 - kr - kb
    u, v = 2.0 * (1.0 - kb), 2.0 * (1.0 - kr)
    return np.array([[1.0, 0.0, v], [1.0, -u * kb / kg, -v * kr / kg], [1.0, u, 0.0]])


def luma(matrix: str) -> Float64:
    """Weights (3,) of coded R, G and B in Y; those of BT.709 for RGB."""
    kr, kb = _LUMA.get(matrix, _LUMA["bt709"])
    return np.array([kr, 1.0 - kr - kb, kb])


def _xyz_from_rgb(name: str) -> Float64:
    """Linear RGB of these primaries to CIE XYZ, adapted to D65."""
    xy = np.array(_CHROMATICITY[name])
    xyz = np.stack([xy[:, 0], xy[:, 1], 1.0 - xy.sum(axis=1)]) / xy[:, 1]
    matrix = xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])
    d65 = np.array([_D65[0], _D65[1], 1.0 - sum(_D65)]) / _D65[1]
    gain = (_BRADFORD @ d65) / (_BRADFORD @ xyz[:, 3])
    return np.asarray(np.linalg.solve(_BRADFORD, gain[:, None] * _BRADFORD) @ matrix)


def primaries_from_bt709(name: str) -> Float64:
    """Matrix (3, 3) from scene-linear BT.709 RGB to RGB of the named primaries."""
    if name == "bt709":
        return np.eye(3)
    return np.asarray(np.linalg.solve(_xyz_from_rgb(name), _xyz_from_rgb("bt709")))


def primaries_at(chromaticities: Sequence[float]) -> str | None:
    """Name of the primaries with x and y of red, green, blue and white (8,); None for others."""
    given = np.reshape(chromaticities, (4, 2))
    for name, known in _CHROMATICITY.items():
        if float(np.abs(given - np.array(known)).max()) <= _SAME_XY:
            return name
    return None


def chromaticities(name: str) -> tuple[float, ...]:
    """Coordinates x and y of the red, green, blue and white (8,) of primaries [1]."""
    return tuple(part for xy in _CHROMATICITY[name] for part in xy)


class ColorTags(Struct, frozen=True, kw_only=True):
    """How the samples of a stream stand for light.

    Attributes:
        matrix: name in `MATRICES`; `gbr` for RGB.
        transfer: name in `TRANSFERS`.
        primaries: name in `PRIMARIES`, or `ap0` or `ap1`.
        full_range: whether the codes span the whole range of the samples.
        assumed: which of the fields the stream did not say, as `field=value`, for the plan.
    """

    matrix: str
    transfer: str
    primaries: str
    full_range: bool
    assumed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        known = map(frozenset, (MATRICES.values(), TRANSFERS.values(), _CHROMATICITY))
        for name, table in zip((self.matrix, self.transfer, self.primaries), known, strict=True):
            if name not in table:
                raise ValueError(f"{name!r} is none of {sorted(table)}")

    @classmethod
    def resolve(
        cls, family: Family, size: tuple[int, int], *, matrix: int, transfer: int, primaries: int,
        range_: int,
    ) -> ColorTags:  # fmt: skip
        """Read FFmpeg's numbers; where they say nothing, assume what players assume.

        YUV without a matrix is BT.709 from 1280x720 up, else BT.601; RGB and greyscale pictures are
        sRGB, float samples linear. RGB, greyscale and float samples are always full range.

        Args:
            family: kind of samples.
            size: coded width and height [px].
            matrix: `AVColorSpace`.
            transfer: `AVColorTransferCharacteristic`.
            primaries: `AVColorPrimaries`.
            range_: `AVColorRange`.

        Raises:
            InputError: the stream says something that is not supported.
        """
        assumed: list[str] = []

        def pick(field: str, table: dict[int, str], tag: int, default: str) -> str:
            if tag in table:
                return table[tag]
            if tag not in _UNSPECIFIED:
                raise InputError(_refusal(field, tag, default))
            assumed.append(f"{field}={default}")
            return default

        if family == "yuv":
            large = size[0] >= 1280 or size[1] >= 720
            tag = matrix or 2  # samples that are YUV cannot be GBR
            chosen = pick("matrix", MATRICES, tag, "bt709" if large else "smpte170m")
            curve = "bt2020-10" if chosen == "bt2020nc" else "bt709"
            if not range_:
                assumed.append("range=limited")
        else:
            chosen = "gbr"
            curve = "linear" if family == "float" else "iec61966-2-1"
        curve = pick("transfer", TRANSFERS, transfer, curve)
        wide = chosen == "bt2020nc" or curve in ("smpte2084", "arib-std-b67")
        gamut = pick("primaries", PRIMARIES, primaries, "bt2020" if wide else "bt709")
        return cls(
            matrix=chosen, transfer=curve, primaries=gamut,
            full_range=family != "yuv" or range_ == FULL_RANGE, assumed=tuple(assumed),
        )  # fmt: skip


def _refusal(field: str, tag: int, instead: str) -> str:
    """Error message for a colour tag that is not supported."""
    name = _NOT_SUPPORTED[field].get(tag, str(tag))
    instead = "bt2020nc" if (field, tag) in _WIDE else instead
    or_override = ", or give --input-transfer if the tag is wrong" if field == "transfer" else ""
    return (
        f"the plate's colour has {field} {name}, which is not supported; convert it first, for "
        f"example with ffmpeg -i IN -vf zscale={field}={instead} OUT.mkv{or_override}"
    )
