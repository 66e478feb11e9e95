"""White noise that is a function of its place, whatever the box, the order, the threads."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from nlens_video.core.layers import Float32

_UINT32 = npt.NDArray[np.uint32]
# The sum of the four bytes of a number, each uniform, is near to normal (Irwin-Hall), within 4
# deviations; its deviation:
_BYTES_DEVIATION = 2.0 * ((256.0**2 - 1.0) / 12.0) ** 0.5


def white_noise(corner: tuple[int, int], size: tuple[int, int], moment: int, seed: int) -> Float32:
    """Noise of mean 0 and deviation 1 on a box of the frame.

    Args:
        corner: row and column of its first pixel, from -2^15 on [px].
        size: rows and columns [px].
        moment: number of the frame.
        seed: another seed is another noise.

    Returns:
        Values (h, w), independent of each other.
    """
    out = np.empty(size, np.float32)
    _fill(out, corner[0], corner[1], np.uint32(moment & 0xFFFFFFFF), np.uint32(seed & 0xFFFFFFFF))
    return out


@njit(inline="always")
def _mixed(value):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """A number whose bits all depend on all bits of another (the finaliser `lowbias32`)."""
    # products and sums of 32 bits become 64 wide: each is cut again
    value = np.uint32(value ^ (value >> np.uint32(16)))
    value = np.uint32(value * np.uint32(0x7FEB352D))
    value = np.uint32(value ^ (value >> np.uint32(15)))
    value = np.uint32(value * np.uint32(0x846CA68B))
    return np.uint32(value ^ (value >> np.uint32(16)))


@njit("void(f4[:,::1], i8, i8, u4, u4)", cache=True, nogil=True)
def _fill(out, top, left, moment, seed):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    start = _mixed(np.uint32(seed ^ _mixed(np.uint32(moment + np.uint32(0x9E3779B9)))))
    scale = np.float32(1.0 / _BYTES_DEVIATION)
    byte = np.uint32(255)
    for i in range(out.shape[0]):
        of_row = _mixed(np.uint32(start ^ np.uint32(top + i)))
        for j in range(out.shape[1]):
            place = np.uint32(np.uint32(left + j) * np.uint32(0x9E3779B1))
            bits = _mixed(np.uint32(of_row + place))
            total = np.uint32(bits & byte) + np.uint32((bits >> np.uint32(8)) & byte)
            total += np.uint32((bits >> np.uint32(16)) & byte) + np.uint32(bits >> np.uint32(24))
            out[i, j] = (np.float32(total) - np.float32(510.0)) * scale


def reference(corner: tuple[int, int], size: tuple[int, int], moment: int, seed: int) -> Float32:
    """`white_noise`, number by number in Python."""

    def mixed(value: int) -> int:
        value ^= value >> 16
        value = value * 0x7FEB352D & 0xFFFFFFFF
        value ^= value >> 15
        value = value * 0x846CA68B & 0xFFFFFFFF
        return value ^ value >> 16

    start = mixed(seed & 0xFFFFFFFF ^ mixed((moment + 0x9E3779B9) & 0xFFFFFFFF))
    out = np.empty(size, np.float32)
    for i, j in np.ndindex(size):
        of_row = mixed(start ^ (corner[0] + i) & 0xFFFFFFFF)
        bits = mixed((of_row + (corner[1] + j) * 0x9E3779B1) & 0xFFFFFFFF)
        out[i, j] = (sum(bits.to_bytes(4, "little")) - 510.0) / _BYTES_DEVIATION
    return out
