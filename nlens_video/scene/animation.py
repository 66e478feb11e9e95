"""Animation: the file's channels sampled at a time, all nodes at once.

glTF 2.0, section 3.11 and appendix C: STEP, LINEAR (spherical for rotations), CUBICSPLINE; the
first and last key hold before and after the key range.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from nlens_video.errors import SceneError
from nlens_video.frames import Float64
from nlens_video.scene.accessors import AccessorReader
from nlens_video.scene.document import Document
from nlens_video.scene.fields import Fields
from nlens_video.scene.nodes import Hierarchy, LocalPose, normalized

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")


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
    """All clips that play.

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


def read_animation(
    document: Document, accessors: AccessorReader, hierarchy: Hierarchy, morphs: dict[int, int]
) -> Animation:
    """All clips of the file, played together.

    A clip that moves what an earlier one moves is an alternative (walk, run) and is left out.

    Args:
        document: the file.
        accessors: its accessors.
        hierarchy: its nodes.
        morphs: number of morph targets by node.

    Raises:
        SceneError: key times that do not increase, or values that do not fit them.
    """
    reader = _TrackReader(document, accessors, hierarchy, morphs)
    tracks: dict[tuple[int, str], Track] = {}
    for clip in document.items("animations"):
        found = reader.clip(clip)
        if any(key in tracks for key in found):
            name = clip.text("name") or clip.place
            document.warn(f"animation '{name}' moves what an earlier one moves and is not played")
        else:
            tracks.update(found)
    return Animation(tuple(tracks.values()))


@dataclass(slots=True)
class _TrackReader:
    document: Document
    accessors: AccessorReader
    hierarchy: Hierarchy
    morphs: dict[int, int]
    _times: dict[int, tuple[float, ...]] = field(default_factory=dict)

    def clip(self, clip: Fields) -> dict[tuple[int, str], Track]:
        """The clip's tracks by node and property."""
        samplers = clip.children("samplers")
        tracks = {}
        for channel in clip.children("channels"):
            target = channel.child("target")
            path = target.text("path")
            node = target.reference("node", len(self.hierarchy.has_matrix))
            if not self._playable(channel, node, path) or node is None:
                continue
            sampler = samplers[channel.integer("sampler", below=len(samplers))]
            width = self.morphs[node] if path == "weights" else _WIDTHS[path]
            tracks[node, path] = self._track(sampler, node, path, width)
        return tracks

    def _playable(self, channel: Fields, node: int | None, path: str) -> bool:
        if node is None or (path not in _WIDTHS and path != "weights"):
            self.document.warn(f"{channel.place} animates '{path}' of no node and is not played")
            return False
        if path == "weights" and not self.morphs.get(node):
            self.document.warn(f"{channel.place} animates weights of a node without morph targets")
            return False
        if path != "weights" and self.hierarchy.has_matrix[node]:
            self.document.warn(f"{channel.place} animates a node with a matrix and is not played")
            return False
        return True

    def _track(self, sampler: Fields, node: int, path: str, width: int) -> Track:
        interpolation = sampler.text("interpolation", "LINEAR")
        if interpolation not in _INTERPOLATIONS:
            raise sampler.wrong("interpolation", "LINEAR, STEP or CUBICSPLINE")
        times = self._key_times(sampler)
        output = sampler.integer("output", below=self.accessors.count)
        flat = self.accessors.floats(output, 1 if path == "weights" else width)
        per_key = 3 if interpolation == "CUBICSPLINE" else 1
        if flat.size != len(times) * per_key * width:
            raise SceneError(
                f"{sampler.place}.output has {flat.size} numbers, expected "
                f"{len(times) * per_key * width} for {len(times)} keys; export the file again"
            )
        keys = flat.astype(np.float64).reshape(len(times), per_key, width)
        if per_key == 1:
            zero = np.zeros_like(keys)
            keys = np.concatenate([zero, keys, zero], axis=1)
        if path == "rotation" and per_key == 1:
            keys[:, 1] = normalized(keys[:, 1])
        return Track(node, path, interpolation, times, keys)

    def _key_times(self, sampler: Fields) -> tuple[float, ...]:
        index = sampler.integer("input", below=self.accessors.count)
        if index not in self._times:
            times = self.accessors.floats(index, 1)[:, 0].astype(np.float64)
            if (np.diff(times) <= 0.0).any() or times[0] < 0.0:
                raise SceneError(
                    f"{sampler.place}.input holds times that do not increase from 0; export again"
                )
            self._times[index] = tuple(times.tolist())
        return self._times[index]
