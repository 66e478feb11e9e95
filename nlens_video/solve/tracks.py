"""Point tracks through a shot: corners followed by pyramidal Lucas-Kanade, checked backwards."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32, Float64

UInt8 = npt.NDArray[np.uint8]
Ints = npt.NDArray[np.int64]

_MOST = 700
_GRID = (6, 10)  # rows and columns of cells that share the points evenly
_WINDOW_PX = 21
_LEVELS = 4
_BACK_PX = 0.4  # a point that does not come back this close is lost
_APART_PX = 12
_MARGIN_PX = 5
_RENEWED = 3  # frames between searches for new corners
_SHORTEST = 6  # observations


@dataclass(slots=True)
class Tracker:
    """Follows points from frame to frame.

    Attributes:
        tracks: observations of each point: frame to position (2,), pixel centres at +0.5 [px].
    """

    tracks: list[dict[int, Float32]] = field(default_factory=list)
    _previous: UInt8 | None = None
    _points: Float32 = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    _ids: list[int] = field(default_factory=list)
    _count: int = 0

    def add(self, luma: UInt8) -> None:
        """Follow all points into the next frame (H, W)."""
        if self._previous is not None and len(self._points):
            self._follow(self._previous, luma)
        if self._count % _RENEWED == 0 and len(self._points) < _MOST:
            self._renew(luma)
        self._previous = luma
        self._count += 1

    def long_tracks(self) -> list[dict[int, Float32]]:
        """Tracks with at least six observations."""
        return [track for track in self.tracks if len(track) >= _SHORTEST]

    def _follow(self, previous: UInt8, luma: UInt8) -> None:
        moved, found = _flow(previous, luma, self._points)
        back, returned = _flow(luma, previous, moved)
        height, width = luma.shape
        inside = (moved > _MARGIN_PX - 1).all(axis=1)
        inside &= (moved[:, 0] < width - _MARGIN_PX) & (moved[:, 1] < height - _MARGIN_PX)
        kept = found & returned & inside
        kept &= np.linalg.norm(back - self._points, axis=1) < _BACK_PX
        self._points = moved[kept]
        self._ids = [one for one, keep in zip(self._ids, kept, strict=True) if keep]
        for one, point in zip(self._ids, self._points, strict=True):
            self.tracks[one][self._count] = point + 0.5

    def _renew(self, luma: UInt8) -> None:
        """Add corners where there are none, evenly over the frame."""
        height, width = luma.shape
        free = np.zeros((height, width), np.uint8)
        free[_MARGIN_PX:-_MARGIN_PX, _MARGIN_PX:-_MARGIN_PX] = 255
        for column, row in self._points:
            cv2.circle(free, (int(column), int(row)), _APART_PX, 0, -1)
        rows, columns = _GRID
        share = max(2, _MOST // (rows * columns))
        for i in range(rows):
            for j in range(columns):
                top, left = i * height // rows, j * width // columns
                cell = np.s_[top : (i + 1) * height // rows, left : (j + 1) * width // columns]
                corners = cv2.goodFeaturesToTrack(
                    luma[cell], share, 0.02, _APART_PX, mask=free[cell], blockSize=7
                )
                for corner in () if corners is None else corners.reshape(-1, 2):
                    point = (corner + (left, top)).astype(np.float32)
                    self._ids.append(len(self.tracks))
                    self.tracks.append({self._count: point + 0.5})
                    self._points = np.concatenate([self._points, point[None]])


def _flow(first: UInt8, second: UInt8, points: Float32) -> tuple[Float32, npt.NDArray[np.bool_]]:
    """Positions of points in the second picture (N, 2), and whether each was found (N,)."""
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        first, second, points.reshape(-1, 1, 2), points.reshape(-1, 1, 2).copy(),
        winSize=(_WINDOW_PX, _WINDOW_PX), maxLevel=_LEVELS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.01),
    )  # fmt: skip
    return np.asarray(moved, np.float32).reshape(-1, 2), np.asarray(found).reshape(-1) == 1


def observations(tracks: list[dict[int, Float32]], frames: list[int]) -> tuple[Ints, Ints, Float64]:
    """Track, frame (as its place in `frames`) and position of each observation in some frames."""
    place = {frame: n for n, frame in enumerate(frames)}
    found = [
        (number, place[frame], *point)
        for number, track in enumerate(tracks)
        for frame, point in track.items()
        if frame in place
    ]
    table = np.array(found, dtype=np.float64).reshape(-1, 4)
    return table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:]
