"""Node animation: keyframe tracks sampled at one time, world matrices composed, normals turned.

One call each for all nodes; node by node in NumPy each takes ten times as long, on every frame,
also while the object is out of view. Below stands a NumPy reference of the kernels, one track and
node at a time: glTF 2.0, section 3.11 and appendix C.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float64
from nlens_video.native import kernels

Table = npt.NDArray[np.int64]
STEP, LINEAR, CUBIC = 0, 1, 2
STEP_LEAD_S = kernels.STEP_LEAD_S
"""By which a value that steps comes before its key: times of keys are rounded to float32, those of
frames to as much as 1 ms, and on the frame of a key its value is seen [s]."""


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
    kernels.sample_tracks(time_s, tracks, times, values, out)


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
    kernels.multiply_nodes(local, order, matrices, has_matrix, world)


def normal_matrices(linear: Float64) -> Float64:
    """What turns normals (N, 3, 3) of surfaces that matrices (N, 3, 3) move.

    These are the inverse transposes, up to scale, also of singular matrices. They are scaled to
    unit size so that they neither overflow nor vanish in float32; that of a mirroring matrix keeps
    its sign, so that normals still point out of the surface.
    """
    rows, sizes = _or_identity(linear)
    rows = rows / sizes
    (a, b, c), (d, e, f), (g, h, i) = rows.transpose(1, 2, 0)
    cofactors = np.stack([
        np.stack([e * i - f * h, f * g - d * i, d * h - e * g], axis=1),
        np.stack([h * c - i * b, i * a - g * c, g * b - h * a], axis=1),
        np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1),
    ], axis=1)  # fmt: skip
    mirrors = np.vecdot(rows[:, 0], cofactors[:, 0]) < 0.0
    turners, sizes = _or_identity(cofactors)
    return np.asarray(turners * (np.where(mirrors, -1.0, 1.0)[:, None, None] / sizes))


def _or_identity(matrices: Float64) -> tuple[Float64, Float64]:
    """Matrices (N, 3, 3), the identity where one is 0, and the size of each (N, 1, 1)."""
    sizes = np.abs(matrices).max(axis=(1, 2), keepdims=True)
    none = sizes == 0.0
    return np.where(none, np.eye(3), matrices), np.where(none, 1.0, sizes)


def sample_ref(
    time_s: float, times: Sequence[float], values: Float64, kind: int, *, turns: bool
) -> Float64:
    """Value (W,) of a track with values (K, 3, W) at a time; its ends hold before and after."""
    lead_s = STEP_LEAD_S if kind == STEP else 0.0
    held = float(np.clip(time_s + lead_s, times[0], times[-1]))
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
