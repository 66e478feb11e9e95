"""Node animation: keyframe tracks sampled at one time, and world matrices composed.

Two calls for all nodes; NumPy takes ten times as long, on every frame, also while the object is out
of view. Below the kernels stands their NumPy reference, one track and node at a time: glTF 2.0,
section 3.11 and appendix C.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float64
from nlens_video.kernels.numba_config import inlined, kernel_of

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


def sample_ref(
    time_s: float, times: Sequence[float], values: Float64, kind: int, *, turns: bool
) -> Float64:
    """Value (W,) of a track with values (K, 3, W) at a time; its ends hold before and after."""
    held = float(np.clip(time_s, times[0], times[-1]))
    key = int(np.searchsorted(times, held, side="right")) - 1
    if key == len(times) - 1 or kind == STEP:
        result = values[key, 1]
    else:
        left, right = values[key], values[key + 1]
        span = times[key + 1] - times[key]
        u = (held - times[key]) / span
        if kind == CUBIC:
            powers = np.array([u**3, u**2, u, 1.0])
            result = (
                powers @ [2.0, -3.0, 0.0, 1.0] * left[1]
                + powers @ [1.0, -2.0, 1.0, 0.0] * span * left[2]
                + powers @ [-2.0, 3.0, 0.0, 0.0] * right[1]
                + powers @ [1.0, -1.0, 0.0, 0.0] * span * right[0]
            )
        elif turns:
            result = _slerp(left[1], right[1], u)
        else:
            result = (1.0 - u) * left[1] + u * right[1]
    if not turns:
        return np.asarray(result)
    length = float(np.linalg.norm(result))
    return np.asarray(result / length if length > 0.0 else [0.0, 0.0, 0.0, 1.0])


def _slerp(left: Float64, right: Float64, u: float) -> Float64:
    """Unit quaternions (4,) interpolated on the sphere, along the shorter way."""
    cosine = float(left @ right)
    if cosine < 0.0:
        right = -right
    angle = float(np.arccos(min(abs(cosine), 1.0)))
    if np.sin(angle) < 1e-6:
        return (1.0 - u) * left + u * right
    return np.asarray(
        (np.sin((1.0 - u) * angle) * left + np.sin(u * angle) * right) / np.sin(angle)
    )


def compose_ref(local: Float64) -> Float64:
    """Matrix (4, 4) of translation * rotation * scale, which lie in a row (10,)."""
    x, y, z, w = local[3:7]
    rotation = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = rotation @ np.diag(local[7:])
    matrix[:3, 3] = local[:3]
    return matrix


def world_ref(node: int, locals_: Sequence[Float64], parents: Sequence[int]) -> Float64:
    """World matrix (4, 4) of a node, from all nodes' local ones (4, 4)."""
    own = locals_[node]
    return own if parents[node] < 0 else world_ref(parents[node], locals_, parents) @ own
