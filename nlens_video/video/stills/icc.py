"""ICC profiles: which of the known primaries and transfer functions one stands for."""

from __future__ import annotations

import struct

import numpy as np

from nlens_video.core.color import PRIMARIES, TRANSFERS, primaries_from_bt709, transfer
from nlens_video.core.layers import Float64

_HEADER = 128
_SAME_XYZ = 3e-3  # primaries that are known differ by 0.019 at least
_SAME_LIGHT = 2e-3  # sRGB and gamma 2.2 differ by 0.0085
_CODES = np.linspace(0.0, 1.0, 257)
# Red, green and blue of BT.709 in CIE XYZ, adapted to D50, to which profiles refer.
_BT709 = np.array(
    [
        [0.4360747, 0.3850649, 0.1430804],
        [0.2225045, 0.7168786, 0.0606169],
        [0.0139322, 0.0971045, 0.7141733],
    ]
)
_PARAMETERS = (1, 3, 4, 5, 7)
"""How many numbers each kind of parametric curve has."""


def profile_colour(profile: bytes) -> tuple[int, int] | None:
    """FFmpeg's numbers of the primaries and the transfer function that a profile stands for.

    Args:
        profile: of a display: three colorants and their curves, or one curve for grey pictures.

    Returns:
        None for profiles of another kind, of other colours, or that are damaged.
    """
    try:
        tags = _tags(profile)
        if profile[16:20] == b"GRAY":
            curve = _transfer(_curve(tags[b"kTRC"]))
            return None if curve is None else (1, curve)
        if profile[16:24] != b"RGB XYZ ":
            return None
        curves = [_curve(tags[letter + b"TRC"]) for letter in (b"r", b"g", b"b")]
        colorants = np.stack([_xyz(tags[letter + b"XYZ"]) for letter in (b"r", b"g", b"b")], axis=1)
    except (KeyError, ValueError, struct.error):
        return None
    primaries, curve = _primaries(colorants), _transfer(curves[0])
    same = all(np.abs(one - curves[0]).max() <= _SAME_LIGHT for one in curves)
    return None if primaries is None or curve is None or not same else (primaries, curve)


def _tags(profile: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", profile, _HEADER)
    entries = profile[_HEADER + 4 : _HEADER + 4 + 12 * count]
    found = struct.iter_unpack(">4sII", entries[: len(entries) // 12 * 12])
    return {name: profile[start : start + size] for name, start, size in found}


def _fixed(data: bytes, count: int, start: int) -> Float64:
    """Numbers of 16 bits before and after the point."""
    return np.array(struct.unpack_from(f">{count}i", data, start)) / 65536.0


def _xyz(tag: bytes) -> Float64:
    if tag[:4] != b"XYZ ":
        raise ValueError(tag[:4])
    return _fixed(tag, 3, 8)


def _curve(tag: bytes) -> Float64:
    """Light of `_CODES`."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return _CODES
        values = np.array(struct.unpack_from(f">{count}H", tag, 12), np.float64)
        if count == 1:
            return np.asarray(_CODES ** (values[0] / 256.0))
        return np.interp(_CODES, np.linspace(0.0, 1.0, count), values / 65535.0)
    if tag[:4] != b"para":
        raise ValueError(tag[:4])
    (kind,) = struct.unpack_from(">H", tag, 8)
    if kind >= len(_PARAMETERS):
        raise ValueError(kind)
    gamma, *given = map(float, _fixed(tag, _PARAMETERS[kind], 12))
    a, b, c, d, e, f = [*given, *(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)[len(given) :]]
    if kind in (1, 2):  # a power of which what is below its root is flat
        a, b, c, d, e, f = a, b, 0.0, -b / (a or 1.0), c, c
    with np.errstate(invalid="ignore"):
        power = np.asarray((a * _CODES + b) ** gamma + e)
    return np.where(_CODES >= d, power, c * _CODES + f)


def _transfer(light: Float64) -> int | None:
    off = {
        number: float(np.abs(transfer(name).decode(_CODES) - light).max())
        for number, name in TRANSFERS.items()
    }
    nearest = min(off, key=lambda number: off[number])
    return nearest if off[nearest] <= _SAME_LIGHT else None


def _primaries(colorants: Float64) -> int | None:
    off = {
        number: float(np.abs(_BT709 @ np.linalg.inv(primaries_from_bt709(name)) - colorants).max())
        for number, name in PRIMARIES.items()
    }
    nearest = min(off, key=lambda number: off[number])
    return nearest if off[nearest] <= _SAME_XYZ else None
