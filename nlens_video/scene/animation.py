"""Animation: the file's channels sampled at a time, all nodes at once.

glTF 2.0, section 3.11 and appendix C: STEP, LINEAR (spherical for rotations), CUBICSPLINE; the
first and last key hold before and after the key range.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from nlens_video.frames import Float64
from nlens_video.scene.nodes import LocalPose, normalized


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One animated property of one node.

    Attributes:
        node: index of the node.
        path: `translation`, `rotation`, `scale` or `weights`.
        interpolation: LINEAR, STEP or CUBICSPLINE.
        times: key times, strictly increasing [s].
        values: keys (K, 3, W): in-tangent, value, out-tangent; zero tangents unless CUBICSPLINE.
    """

    node: int
    path: str
    interpolation: str
    times: tuple[float, ...]
    values: Float64


def locate(times: tuple[float, ...], time_s: float) -> tuple[int, float, float]:
    """The key before a time, how far towards the next (0 to 1), and their distance [s]."""
    key = bisect_right(times, time_s) - 1
    if key < 0:
        return 0, 0.0, 0.0
    if key >= len(times) - 1:
        return len(times) - 1, 0.0, 0.0
    span = times[key + 1] - times[key]
    return key, (time_s - times[key]) / span, span


@dataclass(slots=True)
class _Bank:
    """Tracks of one property and interpolation, sampled together."""

    tracks: list[Track]
    values: Float64 = field(init=False)
    nodes: list[int] = field(init=False)
    starts: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.values = np.concatenate([track.values for track in self.tracks])
        self.nodes = [track.node for track in self.tracks]
        lengths = [len(track.times) for track in self.tracks]
        self.starts = [sum(lengths[:i]) for i in range(len(lengths))]

    def sample(self, time_s: float) -> Float64:
        """Values (tracks, W) at a time [s]."""
        first = self.tracks[0]
        # Most exporters give all channels of a clip the same key times: search each only once.
        found: dict[int, tuple[int, float, float]] = {}
        for track in self.tracks:
            if id(track.times) not in found:
                found[id(track.times)] = locate(track.times, time_s)
        where = [found[id(track.times)] for track in self.tracks]
        left = np.array([s + w[0] for s, w in zip(self.starts, where, strict=True)], dtype=np.intp)
        u = np.array([w[1] for w in where])[:, None]
        right = left + (u[:, 0] > 0.0)
        if first.interpolation == "CUBICSPLINE":
            span = np.array([w[2] for w in where])[:, None]
            mixed = hermite(self.values[left], self.values[right], u, span)
        elif first.interpolation == "STEP":
            mixed = self.values[left, 1]
        elif first.path == "rotation":
            mixed = slerp(self.values[left, 1], self.values[right, 1], u)
        else:
            mixed = (1.0 - u) * self.values[left, 1] + u * self.values[right, 1]
        return normalized(mixed) if first.path == "rotation" else mixed


def hermite(left: Float64, right: Float64, u: Float64, span: Float64) -> Float64:
    """Cubic Hermite spline between keys (N, 3, W) at u (N, 1) of spans (N, 1) [s]."""
    u2, u3 = u * u, u * u * u
    return np.asarray(
        (2.0 * u3 - 3.0 * u2 + 1.0) * left[:, 1]
        + (u3 - 2.0 * u2 + u) * span * left[:, 2]
        + (3.0 * u2 - 2.0 * u3) * right[:, 1]
        + (u3 - u2) * span * right[:, 0]
    )


def slerp(left: Float64, right: Float64, u: Float64) -> Float64:
    """Spherical interpolation of unit quaternions (N, 4) at u (N, 1), along the shorter way."""
    cosine = np.einsum("ij,ij->i", left, right)[:, None]
    right = np.where(cosine < 0.0, -right, right)
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.sin(angle)
    near = sine < 1e-6  # the two weights tend to the linear ones
    safe = np.where(near, 1.0, sine)
    a = np.where(near, 1.0 - u, np.sin((1.0 - u) * angle) / safe)
    b = np.where(near, u, np.sin(u * angle) / safe)
    return np.asarray(a * left + b * right)


@dataclass(slots=True)
class Animation:
    """What plays.

    Attributes:
        tracks: animated properties; each node's property at most once.
        duration_s: time of the last key [s]; 0 where nothing is animated.
    """

    tracks: tuple[Track, ...]
    duration_s: float = field(init=False)
    _banks: list[_Bank] = field(init=False)
    _weights: list[_Bank] = field(init=False)

    def __post_init__(self) -> None:
        self.duration_s = max((track.times[-1] for track in self.tracks), default=0.0)
        groups: dict[tuple[str, str], list[Track]] = {}
        for track in self.tracks:
            if track.path != "weights":
                groups.setdefault((track.path, track.interpolation), []).append(track)
        self._banks = [_Bank(tracks) for tracks in groups.values()]
        self._weights = [_Bank([track]) for track in self.tracks if track.path == "weights"]

    def apply(self, rest: LocalPose, time_s: float) -> LocalPose:
        """Local transforms at a time [s]."""
        if not self._banks:
            return rest
        pose = rest.copy()
        targets = {
            "translation": pose.translation,
            "rotation": pose.rotation,
            "scale": pose.scale,
        }
        for bank in self._banks:
            targets[bank.tracks[0].path][bank.nodes] = bank.sample(time_s)
        return pose

    def weights(self, time_s: float) -> dict[int, Float64]:
        """Animated morph weights by node at a time [s]."""
        return {bank.nodes[0]: bank.sample(time_s)[0] for bank in self._weights}
