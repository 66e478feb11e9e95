"""Node animation: keyframe tracks sampled at one time, and world matrices composed.

Two calls for all nodes; NumPy takes ten times as long, on every frame, also while the object is out
of view. Defined by `kernels_ref`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.kernels.numba_config import inlined, kernel_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from nlens_video.core.layers import Bool, Float64

    Table = npt.NDArray[np.int64]

STEP, LINEAR, CUBIC = 0, 1, 2
_ALIKE = 1e-6  # sine of the angle between rotations, below which their weights are linear
# columns of `tracks`
_ROW, _COLUMN, _WIDTH, _KIND, _TURNS, _TIMES, _VALUES, _COUNT = range(8)


@inlined
def _key_before(times: Float64, first: int, count: int, time_s: float) -> int:
    """The last key of a track at or before a time, from 0; -1 where there is none."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if times[first + middle] <= time_s:
            low = middle + 1
        else:
            high = middle
    return low - 1


@inlined
def _linear_weights(left: Float64, right: Float64, u: float, turns: int) -> tuple[float, float]:
    """Weights of two neighbouring keys; of rotations along the shorter way on the sphere."""
    if not turns:
        return 1.0 - u, u
    cosine = 0.0
    for k in range(4):
        cosine += left[k] * right[k]
    sign = -1.0 if cosine < 0.0 else 1.0
    angle = math.acos(min(abs(cosine), 1.0))
    sine = math.sin(angle)
    if sine < _ALIKE:
        return 1.0 - u, sign * u
    return math.sin((1.0 - u) * angle) / sine, sign * math.sin(u * angle) / sine


@inlined
def _normalize(rotation: Float64) -> None:
    """Make a quaternion (4,) one of length 1; the identity where it has none."""
    square = 0.0
    for k in range(4):
        square += rotation[k] * rotation[k]
    length = math.sqrt(square)
    for k in range(4):
        rotation[k] = rotation[k] / length if length > 0.0 else (1.0 if k == 3 else 0.0)


@kernel_of("void(f8,i8[:,::1],f8[::1],f8[:,:,::1],f8[:,::1])")
def sample(time_s: float, tracks: Table, times: Float64, values: Float64, out: Float64) -> None:
    """Sample tracks at a time into the rows of `out`; other values stay.

    Args:
        time_s: the time [s].
        tracks: by track (T, 8): row and first column of `out`, width, interpolation, whether it is
            a rotation, its first key in `times` and in `values`, number of keys.
        times: key times of all tracks [s].
        values: in-tangent, value and out-tangent of all keys (K, 3, W).
        out: what is filled in.
    """
    for t in range(len(tracks)):
        width, kind, turns = tracks[t, _WIDTH], tracks[t, _KIND], tracks[t, _TURNS]
        first, count = tracks[t, _TIMES], tracks[t, _COUNT]
        column = tracks[t, _COLUMN]
        target = out[tracks[t, _ROW], column : column + width]
        key = _key_before(times, first, count, time_s)
        u = span = 0.0
        if 0 <= key < count - 1:
            span = times[first + key + 1] - times[first + key]
            u = (time_s - times[first + key]) / span
        left = values[tracks[t, _VALUES] + max(key, 0)]
        if u == 0.0 or kind == STEP:
            for k in range(width):
                target[k] = left[1, k]
        else:
            right = values[tracks[t, _VALUES] + key + 1]
            a, b, leaving, arriving = 0.0, 0.0, 0.0, 0.0
            if kind == CUBIC:
                u2, u3 = u * u, u * u * u
                a, b = 2.0 * u3 - 3.0 * u2 + 1.0, 3.0 * u2 - 2.0 * u3
                leaving, arriving = (u3 - 2.0 * u2 + u) * span, (u3 - u2) * span
            else:
                a, b = _linear_weights(left[1], right[1], u, turns)
            for k in range(width):
                target[k] = a * left[1, k] + b * right[1, k]
                if kind == CUBIC:  # tangents of others are not there to be multiplied
                    target[k] += leaving * left[2, k] + arriving * right[0, k]
        if turns:
            _normalize(target)


@inlined
def _compose(local: Float64, matrix: Float64) -> None:
    """Fill in the matrix (4, 4) of translation * rotation * scale."""
    x, y, z, w = local[3], local[4], local[5], local[6]
    matrix[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[0, 1] = 2.0 * (x * y - z * w)
    matrix[0, 2] = 2.0 * (x * z + y * w)
    matrix[1, 0] = 2.0 * (x * y + z * w)
    matrix[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[1, 2] = 2.0 * (y * z - x * w)
    matrix[2, 0] = 2.0 * (x * z - y * w)
    matrix[2, 1] = 2.0 * (y * z + x * w)
    matrix[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    for row in range(3):
        for column in range(3):
            matrix[row, column] *= local[7 + column]
        matrix[row, 3] = local[row]
        matrix[3, row] = 0.0
    matrix[3, 3] = 1.0


@kernel_of("void(f8[:,::1],i8[:,::1],f8[:,:,::1],b1[::1],f8[:,:,::1])")
def multiply(
    local: Float64, order: Table, matrices: Float64, has_matrix: Bool, world: Float64
) -> None:
    """Fill in world matrices (N, 4, 4).

    Args:
        local: translation, rotation x y z w and scale of each node (N, 10).
        order: nodes and their parents (N, 2), parents before what they carry; -1 for none.
        matrices: local matrices (N, 4, 4) of nodes that have one.
        has_matrix: which nodes have one (N,).
        world: what is filled in.
    """
    for n in range(len(order)):
        node, parent = order[n, 0], order[n, 1]
        own = world[node]
        if has_matrix[node]:
            for k in range(16):
                own[k // 4, k % 4] = matrices[node, k // 4, k % 4]
        else:
            _compose(local[node], own)
        if parent < 0:
            continue
        above = world[parent]
        for column in range(4):
            a, b, c, d = own[0, column], own[1, column], own[2, column], own[3, column]
            for row in range(4):
                own[row, column] = (
                    above[row, 0] * a + above[row, 1] * b + above[row, 2] * c + above[row, 3] * d
                )
