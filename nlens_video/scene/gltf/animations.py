"""Animations: keyframe tracks evaluated at a time, which of the file's play, and their reader.

glTF 2.0, section 3.11 and appendix C: STEP, LINEAR (spherical for rotations), CUBICSPLINE; the
first and last key hold before and after the key range.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.settings import ALL
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.animation_kernels import CUBIC, LINEAR, STEP, sample
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.nodes import Hierarchy, normalized

TrackKey = tuple[int, str]
_LISTED = 12
_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_COLUMNS = {"translation": 0, "rotation": 3, "scale": 7}  # of a node's row
_KINDS = {"STEP": STEP, "LINEAR": LINEAR, "CUBICSPLINE": CUBIC}


@dataclass(frozen=True, slots=True, eq=False)
class AnimationTrack:
    """One animated property of one node.

    Attributes:
        node: index of the node.
        path: `translation`, `rotation`, `scale` or `weights`.
        kind: LINEAR, STEP or CUBIC interpolation.
        times: key times, strictly increasing [s].
        values: keys (K, 3, W): in-tangent, value, out-tangent; zero tangents unless CUBIC.
    """

    node: int
    path: str
    kind: int
    times: tuple[float, ...]
    values: Float64


@dataclass(slots=True)
class Animation:
    """The tracks that play.

    Attributes:
        tracks: animated properties; each node's property at most once.
        duration_s: time of the last key [s]; 0 where nothing is animated.
    """

    tracks: tuple[AnimationTrack, ...]
    duration_s: float = field(init=False)
    _moving: _Bank | None = field(init=False)
    _morphing: dict[int, _Bank] = field(init=False)

    def __post_init__(self) -> None:
        self.duration_s = max((track.times[-1] for track in self.tracks), default=0.0)
        moving = [track for track in self.tracks if track.path != "weights"]
        self._moving = _Bank.of(moving) if moving else None
        self._morphing = {
            track.node: _Bank.of([track]) for track in self.tracks if track.path == "weights"
        }

    def apply(self, rest: Float64, time_s: float) -> Float64:
        """Translation, rotation and scale of all nodes (N, 10) at a time [s].

        Args:
            rest: what they are without animation (N, 10).
            time_s: the time [s].
        """
        if self._moving is None:
            return rest
        local = rest.copy()
        self._moving.sample(time_s, local)
        return local

    @property
    def morphs(self) -> bool:
        """Whether morph weights are animated."""
        return bool(self._morphing)

    def weights(self, time_s: float) -> dict[int, Float64]:
        """Animated morph weights by node at a time [s]."""
        found = {}
        for node, bank in self._morphing.items():
            row = np.empty((1, bank.values.shape[2]))
            bank.sample(time_s, row)
            found[node] = row[0]
        return found


@dataclass(frozen=True, slots=True, eq=False)
class _Bank:
    """Tracks as the kernel takes them; see `animation_kernels.sample`."""

    tracks: npt.NDArray[np.int64]
    times: Float64
    values: Float64

    @classmethod
    def of(cls, tracks: Sequence[AnimationTrack]) -> _Bank:
        widest = max(track.values.shape[2] for track in tracks)
        values = np.zeros((sum(len(track.times) for track in tracks), 3, widest))
        # Most exporters give all channels of a clip the same key times: keep each only once.
        times = {id(track.times): track.times for track in tracks}
        starts = dict(zip(times, np.cumsum([0, *map(len, times.values())]).tolist(), strict=False))
        rows = []
        first = 0
        for track in tracks:
            count, _, width = track.values.shape
            values[first : first + count, :, :width] = track.values
            weights = track.path == "weights"
            row, column = (0, 0) if weights else (track.node, _COLUMNS[track.path])
            rows.append((
                row, column, width, track.kind, track.path == "rotation",
                starts[id(track.times)], first, count,
            ))  # fmt: skip
            first += count
        return cls(np.array(rows, np.int64), np.concatenate(list(times.values())), values)

    def sample(self, time_s: float, out: Float64) -> None:
        """Put values at a time [s] into the rows and columns of what they animate."""
        sample(time_s, self.tracks, self.times, self.values, out)


@dataclass(frozen=True, slots=True)
class Animations:
    """The file's animations, of which one or all play.

    Attributes:
        names: of all, in the file's order; possibly empty or alike.
        clips: tracks of each by node and property.
    """

    names: tuple[str, ...]
    clips: tuple[dict[TrackKey, AnimationTrack], ...]

    def chosen(self, which: str) -> Animation:
        """What plays: one animation by its name, else by its number, or all.

        Of those that move the same thing (walk, run), all means the first; see `left_out`.

        Raises:
            SceneError: the file has no such animation.
        """
        if which == ALL and ALL not in self.names:
            left_out = self._alternatives()
            clips = [clip for at, clip in enumerate(self.clips) if at not in left_out]
        else:
            clips = [self.clips[self._number(which)]]
        return Animation(tuple(track for clip in clips for track in clip.values()))

    def left_out(self, which: str) -> tuple[str, ...]:
        """Names of those that do not play though `all` was said: alternatives of the others."""
        if which != ALL or ALL in self.names:
            return ()
        return tuple(self.names[number] or f"number {number}" for number in self._alternatives())

    def of_nodes(self, nodes: frozenset[int]) -> Animation:
        """All that moves some nodes, whichever animation plays on the rest."""
        tracks: dict[TrackKey, AnimationTrack] = {}
        for clip in self.clips:
            tracks = clip | tracks
        return Animation(tuple(track for track in tracks.values() if track.node in nodes))

    def _alternatives(self) -> tuple[int, ...]:
        taken: set[TrackKey] = set()
        left: list[int] = []
        for number, clip in enumerate(self.clips):
            if taken.isdisjoint(clip):
                taken.update(clip)
            else:
                left.append(number)
        return tuple(left)

    def _number(self, which: str) -> int:
        if which in self.names:
            return self.names.index(which)
        if which.isdecimal() and len(which) < 9 and int(which) < len(self.clips):
            return int(which)
        if not self.clips:
            raise SceneError(f"no animation '{which}': the file has none; leave --animation out")
        raise SceneError(f"no animation '{which}'; expected all or one of {listed(self.names)}")


def listed(names: Sequence[str]) -> str:
    """Names for a message, the first dozen of many."""
    known = ", ".join(name[:40] or f"number {at}" for at, name in enumerate(names[:_LISTED]))
    return known if len(names) <= _LISTED else f"{known} and {len(names) - _LISTED} more"


def read_animations(
    document: Document, accessors: AccessorReader, hierarchy: Hierarchy, morphs: dict[int, int]
) -> Animations:
    """All animations of the file.

    Args:
        document: the file.
        accessors: its accessors.
        hierarchy: its nodes.
        morphs: number of morph targets by node.

    Raises:
        SceneError: key times that do not increase, or values that do not fit them.
    """
    reader = _TrackReader(document, accessors, hierarchy, morphs)
    items = document.items("animations")
    return Animations(
        names=tuple(item.name for item in items),
        clips=tuple(reader.clip(item) for item in items),
    )


@dataclass(slots=True)
class _TrackReader:
    document: Document
    accessors: AccessorReader
    hierarchy: Hierarchy
    morphs: dict[int, int]
    _times: dict[int, tuple[float, ...]] = field(default_factory=dict)

    def clip(self, clip: Fields) -> dict[TrackKey, AnimationTrack]:
        """An animation's tracks by node and property."""
        samplers = clip.children("samplers")
        tracks: dict[TrackKey, AnimationTrack] = {}
        unplayed: Counter[str] = Counter()
        for channel in clip.children("channels"):
            target = channel.child("target")
            path = target.text("path")
            node = target.reference("node", len(self.hierarchy.has_matrix))
            fault = self._fault(node, path)
            if fault or node is None:
                unplayed[fault] += 1
                continue
            sampler = samplers[channel.integer("sampler", below=len(samplers))]
            width = self.morphs[node] if path == "weights" else _WIDTHS[path]
            tracks[node, path] = self._track(sampler, node, path, width)
        for fault, count in unplayed.items():
            self.document.warn(f"{clip.place}: {count} channels are not played: {fault}")
        return tracks

    def _fault(self, node: int | None, path: str) -> str:
        """Why a channel is not played, empty where it is."""
        if node is None or (path not in _WIDTHS and path != "weights"):
            return f"they animate '{path[:40]}' of no node"
        if path == "weights" and not self.morphs.get(node):
            return "they animate weights of a node that is not drawn or has no morph targets"
        if path != "weights" and self.hierarchy.has_matrix[node]:
            return "they animate a node with a matrix"
        return ""

    def _track(self, sampler: Fields, node: int, path: str, width: int) -> AnimationTrack:
        kind = _KINDS[sampler.choice("interpolation", _KINDS, "LINEAR")]
        times = self._key_times(sampler)
        output = sampler.integer("output", below=self.accessors.count)
        self.document.spend(2 * 8 * 3 * len(times) * width, sampler.place)
        flat = self.accessors.floats(output, 1 if path == "weights" else width)
        per_key = 3 if kind == CUBIC else 1
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
        return AnimationTrack(node, path, kind, times, keys)

    def _key_times(self, sampler: Fields) -> tuple[float, ...]:
        index = sampler.integer("input", below=self.accessors.count)
        if index not in self._times:
            self.document.spend(48 * self.accessors.length(index), sampler.place)
            times = self.accessors.floats(index, 1)[:, 0].astype(np.float64)
            if (np.diff(times) <= 0.0).any() or times[0] < 0.0:
                raise SceneError(
                    f"{sampler.place}.input holds times that do not increase from 0; export again"
                )
            self._times[index] = tuple(times.tolist())
        return self._times[index]
