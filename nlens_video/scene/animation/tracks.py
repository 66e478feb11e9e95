"""Animation: the file's channels sampled at a time, all of them at once.

glTF 2.0, section 3.11 and appendix C: STEP, LINEAR (spherical for rotations), CUBICSPLINE; the
first and last key hold before and after the key range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float64

_COLUMNS = {"translation": 0, "rotation": 3, "scale": 7}  # of a node's row
_KINDS = {"STEP": 0, "LINEAR": 1, "CUBICSPLINE": 2}  # as in `animation.kernels`


@dataclass(frozen=True, slots=True, eq=False)
class AnimationTrack:
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


@dataclass(slots=True)
class Animation:
    """What plays.

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
    """Tracks as the kernel takes them; see `animation.kernels.sample`."""

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
                row, column, width, _KINDS[track.interpolation], track.path == "rotation",
                starts[id(track.times)], first, count,
            ))  # fmt: skip
            first += count
        return cls(np.array(rows, np.int64), np.concatenate(list(times.values())), values)

    def sample(self, time_s: float, out: Float64) -> None:
        """Put values at a time [s] into the rows and columns of what they animate."""
        from nlens_video.scene.animation.kernels import sample  # here: numba takes long to load

        sample(time_s, self.tracks, self.times, self.values, out)
