"""Animations: keyframe tracks evaluated at a time, and which of the file's play.

glTF 2.0, section 3.11 and appendix C: STEP, LINEAR (spherical for rotations), CUBICSPLINE; the
first and last key hold before and after the key range.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.objects import ALL
from nlens_video.scene.gltf.animation_kernels import STEP, STEP_LEAD_S, sample
from nlens_video.scene.gltf.document import Document

TrackKey = tuple[int, str]
_LISTED = 12
_COLUMNS = {"translation": 0, "rotation": 3, "scale": 7}  # of a node's row


class AnimationTrack(Struct, frozen=True, eq=False):
    """One animated property of one node or camera.

    Attributes:
        node: index of the node; of the camera, for `yfov`.
        path: `translation`, `rotation`, `scale`, `weights` or `yfov`.
        kind: LINEAR, STEP or CUBIC interpolation.
        times: key times, strictly increasing [s].
        values: keys (K, 3, W): in-tangent, value, out-tangent; zero tangents unless CUBIC.
    """

    node: int
    path: str
    kind: int
    times: tuple[float, ...]
    values: Float64

    @property
    def changes(self) -> bool:
        """Whether its value changes at all."""
        values = self.values
        return bool((values[1:, 1] != values[:1, 1]).any() or values[:, ::2].any())

    def steps(self) -> Iterator[float]:
        """Times at which the value becomes another, those of its keys but for the lead [s]."""
        values = self.values[:, 1]
        for key in np.flatnonzero((values[1:] != values[:-1]).any(axis=1)):
            yield self.times[key + 1] - STEP_LEAD_S


@dataclass(slots=True)
class Animation:
    """The tracks that play.

    Attributes:
        tracks: animated properties; each node's property at most once.
        start_s: time of the first key of what changes [s]; None where nothing does.
        duration_s: time of the last key [s]; 0 where nothing is animated.
        steps: times at which a value changes at once, from the first on [s].
    """

    tracks: tuple[AnimationTrack, ...]
    start_s: float | None = field(init=False)
    duration_s: float = field(init=False)
    steps: tuple[float, ...] = field(init=False)
    _moving: _Bank | None = field(init=False)
    _morphing: dict[int, _Bank] = field(init=False)
    _zooming: dict[int, _Bank] = field(init=False)

    def __post_init__(self) -> None:
        starts = (track.times[0] for track in self.tracks if track.changes)
        self.start_s = min(starts, default=None)
        self.duration_s = max((track.times[-1] for track in self.tracks), default=0.0)
        stepping = (track for track in self.tracks if track.kind == STEP)
        self.steps = tuple(sorted({time for track in stepping for time in track.steps()}))
        moving = [track for track in self.tracks if track.path in _COLUMNS]
        self._moving = _Bank.of(moving) if moving else None
        self._morphing, self._zooming = (
            {track.node: _Bank.of([track]) for track in self.tracks if track.path == path}
            for path in ("weights", "yfov")
        )

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

    def yfov(self, camera: int, time_s: float) -> float | None:
        """Vertical field of view of a camera at a time [s], None where it does not change [rad]."""
        bank = self._zooming.get(camera)
        if bank is None:
            return None
        row = np.empty((1, 1))
        bank.sample(time_s, row)
        return float(row[0, 0])

    def zoom_ends(self, camera: int) -> tuple[float, ...]:
        """Times of the keys of a camera's least and greatest field of view [s], none without."""
        bank = self._zooming.get(camera)
        if bank is None:
            return ()
        angles = bank.values[:, 1, 0]
        return float(bank.times[np.argmin(angles)]), float(bank.times[np.argmax(angles)])


class _Bank(Struct, frozen=True, eq=False):
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
            alone = track.path not in _COLUMNS  # in a bank of its own, whose row it fills
            row, column = (0, 0) if alone else (track.node, _COLUMNS[track.path])
            rows.append((
                row, column, width, track.kind, track.path == "rotation",
                starts[id(track.times)], first, count,
            ))  # fmt: skip
            first += count
        return cls(np.array(rows, np.int64), np.concatenate(list(times.values())), values)

    def sample(self, time_s: float, out: Float64) -> None:
        """Put values at a time [s] into the rows and columns of what they animate."""
        sample(time_s, self.tracks, self.times, self.values, out)


class Animations(Struct, frozen=True):
    """The file's animations, of which one or all play.

    Attributes:
        names: of all, in the file's order; possibly empty or alike.
        clips: tracks of each by node and property.
    """

    names: tuple[str, ...]
    clips: tuple[dict[TrackKey, AnimationTrack], ...]

    def of_objects(self, nodes: frozenset[int], which: str) -> Animation:
        """What plays of what moves some nodes: one animation by its name or number, or all.

        Of those that move the same thing (walk, run), all means the first; see `name_alternatives`.

        Raises:
            SceneError: the file has no such animation.
        """
        if self._all_play(which):
            left_out = self._alternatives()
            clips = [clip for at, clip in enumerate(self.clips) if at not in left_out]
        else:
            clips = [self.clips[self._number(which)]]
        tracks = (track for clip in clips for track in clip.values())
        return Animation(tuple(t for t in tracks if t.path != "yfov" and t.node in nodes))

    def name_alternatives(self, document: Document, which: str) -> None:
        """Warn of those that do not play though `all` was said: alternatives of the others."""
        left_out = self._alternatives() if self._all_play(which) else ()
        if not left_out:
            return
        names = [name or f"number {number}" for number, name in enumerate(self.names)]
        played = [name for number, name in enumerate(names) if number not in left_out]
        left = [names[number] for number in left_out]
        document.warn(
            f"{listed(played)} {'plays' if len(played) == 1 else 'play'}; {listed(left, 4)} "
            "would move the same parts: choose with --animation NAME"
        )

    def of_cameras(self, nodes: frozenset[int], which: str) -> Animation:
        """All that moves some nodes and zooms cameras, whichever animation plays on the rest.

        What plays comes first; of what it leaves alone, the first animation of each.

        Raises:
            SceneError: the file has no such animation.
        """
        tracks = {} if self._all_play(which) else self.clips[self._number(which)]
        for clip in self.clips:
            tracks = clip | tracks
        return Animation(tuple(t for t in tracks.values() if t.path == "yfov" or t.node in nodes))

    def _all_play(self, which: str) -> bool:
        return which == ALL and ALL not in self.names

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


def listed(names: Sequence[str], most: int = _LISTED) -> str:
    """Names for a message, the first of many."""
    known = ", ".join(name[:40] or f"number {at}" for at, name in enumerate(names[:most]))
    return known if len(names) <= most else f"{known} and {len(names) - most} more"
