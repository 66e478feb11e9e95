"""Definition of `kernels`: glTF 2.0, section 3.11 and appendix C, one track and node at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.scene.animation.kernels import CUBIC, STEP


def sampled(
    time_s: float, times: Sequence[float], values: Float64, kind: int, *, turns: bool
) -> Float64:
    """Value (W,) of a track at a time; the first and last key hold before and after them.

    Args:
        time_s: the time [s].
        times: of its keys, increasing [s].
        values: in-tangent, value and out-tangent of its keys (K, 3, W).
        kind: STEP, LINEAR or CUBIC.
        turns: whether it is a rotation: a quaternion x y z w.
    """
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


def composed(local: Float64) -> Float64:
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


def world(node: int, locals_: Sequence[Float64], parents: Sequence[int]) -> Float64:
    """World matrix (4, 4) of a node, from all nodes' local ones (4, 4)."""
    own = locals_[node]
    return own if parents[node] < 0 else world(parents[node], locals_, parents) @ own
