"""Point tracks through a shot: corners followed by steps and held to their first patch."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32, Picture
from nlens_video.solve.points.observations import Ints, Observations
from nlens_video.solve.points.patches import Patches

UInt8 = npt.NDArray[np.uint8]

_MOST = 700
_GRID = (6, 10)  # rows and columns of cells that share the points evenly
_WINDOW_PX = 21
_LEVELS = 4
_APART_PX = 12
_MARGIN_PX = 5
_BACK_PX = 0.4  # a point that does not come back this close is lost
_RENEWED = 3  # frames between searches for new corners
_SHORTEST = 6  # observations of a point whose way counts
_STRAYED_PX = 0.75
_FEWEST = 8  # such points of a frame that is judged
_STAYS = 0.4  # share of the cells with points that hold one at its place, as a still camera sees
_MOST_LEFT = 2, 0.1  # frames, and share of them, that may show less: much is lifted or passes by
_GONE = 0.15  # share of the cells of a frame that holds nothing, as a shaken one
_MOST_GONE = 2, 0.02  # such frames, and share of them
_FEW, _CUT_KEPT = 20, 0.3  # points, and share of them that a cut leaves at most
_CUT_LIGHT = 0.06  # mean change of the light of a grid's cells in a cut [1]
_CELLS = (8, 6)


@dataclass(slots=True)
class Tracker:
    """Follows points from frame to frame.

    Attributes:
        most: points that are followed at once, about [1].
        recorded: whether observations are kept.
        observations: where each frame shows them; empty where they are not kept.
        steps_px: how far the middle point moved into each frame [px].
        cut: the first frame that shows another picture than the one before it, None before one.
    """

    most: int = _MOST
    recorded: bool = True
    observations: Observations = field(default_factory=Observations)
    steps_px: list[float] = field(default_factory=list)
    cut: int | None = None
    _previous: UInt8 | None = None
    _points: Float32 = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    _starts: Float32 = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    _seen: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    _numbers: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    _patches: Patches = field(default_factory=Patches)
    _begun: int = 0
    _judged: int = 0
    _left: int = 0
    _gone: int = 0

    def add(self, luma: UInt8) -> None:
        """Follow all points into the next frame (H, W)."""
        step = 0.0
        if self._previous is not None and len(self._points):
            before = len(self._points)
            step = self._follow(self._previous, luma)
            lost = before >= _FEW and len(self._points) < _CUT_KEPT * before
            if self.cut is None and lost and _light_change(self._previous, luma) > _CUT_LIGHT:
                self.cut = len(self.steps_px)
        self.steps_px.append(step)
        if len(self.steps_px) % _RENEWED == 1 and len(self._points) < self.most:
            self._renew(luma)
        if self.recorded:
            self.observations.add(self._numbers, self._points + 0.5)
        self._previous = luma

    @property
    def moves(self) -> bool:
        """Whether the picture as a whole leaves its place.

        Things that move, or shimmer in noise, may be most of the points. Before a still camera some
        stay at their place all over the frame, and a few of them at all times.
        """
        return any(
            count > max(fewest, share * self._judged)
            for count, (fewest, share) in ((self._left, _MOST_LEFT), (self._gone, _MOST_GONE))
        )

    @property
    def current(self) -> dict[int, Float32]:
        """Positions of the points in the newest frame, by a number that each keeps."""
        places = self._points + np.float32(0.5)
        return dict(zip(self._numbers.tolist(), places, strict=True))

    def _follow(self, previous: UInt8, luma: UInt8) -> float:
        moved, found = _flow(previous, luma, self._points)
        places, alike = self._patches.find(luma, moved)
        kept = alike & found & _inside(places, luma)
        steps = np.linalg.norm(places - self._points, axis=1)[kept]
        self._patches.keep(kept)
        self._points, self._starts = places[kept], self._starts[kept]
        self._numbers, self._seen = self._numbers[kept], self._seen[kept] + 1
        self._judge(luma.shape)
        return float(np.median(steps)) if len(steps) else 0.0

    def _judge(self, shape: tuple[int, ...]) -> None:
        """Count the frame as one that has left its place, or as one that has not."""
        often = self._seen >= _SHORTEST
        if often.sum() < _FEWEST:
            return
        stays = np.linalg.norm(self._points - self._starts, axis=1) < _STRAYED_PX
        rows, columns = (self._points[:, ::-1] / shape * _GRID).astype(np.int64).T
        cells = rows * _GRID[1] + columns
        held, whole = (np.count_nonzero(np.bincount(cells[m])) for m in (often & stays, often))
        self._judged += 1
        self._left += int(held < _STAYS * whole)
        self._gone += int(held < _GONE * whole)

    def _renew(self, luma: UInt8) -> None:
        """Add corners where there are none, evenly over the frame."""
        height, width = luma.shape
        free = np.zeros((height, width), np.uint8)
        free[_MARGIN_PX:-_MARGIN_PX, _MARGIN_PX:-_MARGIN_PX] = 255
        for column, row in self._points:
            cv2.circle(free, (int(column), int(row)), _APART_PX, 0, -1)
        rows, columns = _GRID
        share = max(2, self.most // (rows * columns))
        found = []
        for i in range(rows):
            for j in range(columns):
                top, left = i * height // rows, j * width // columns
                cell = np.s_[top : (i + 1) * height // rows, left : (j + 1) * width // columns]
                corners = cv2.goodFeaturesToTrack(
                    luma[cell], share, 0.02, _APART_PX, mask=free[cell], blockSize=7
                )
                if corners is not None:
                    found.append(corners.reshape(-1, 2) + np.array((left, top), np.float32))
        if not found:
            return
        points = np.concatenate(found).astype(np.float32)
        self._patches.add(luma, points)
        self._points = np.concatenate([self._points, points])
        self._starts = np.concatenate([self._starts, points])
        self._seen = np.concatenate([self._seen, np.ones(len(points), np.int64)])
        numbers = np.arange(self._begun, self._begun + len(points))
        self._numbers = np.concatenate([self._numbers, numbers])
        self._begun += len(points)


def luma_of(picture: Picture, size: tuple[int, int]) -> UInt8:
    """Square root of the green light as 8 bit (H, W), which points are tracked in.

    Args:
        picture: a frame.
        size: columns and rows, at most those of the frame [px].
    """
    light = picture.downsample(*size)[..., 1]
    return np.asarray(np.sqrt(np.clip(light, 0.0, 1.0)) * 255.0 + 0.5, np.uint8)


def follow(previous: UInt8, luma: UInt8, points: Float32) -> tuple[Float32, Bool]:
    """Follow points (N, 2) into the next picture, and back again as a check.

    Args:
        previous: picture (H, W).
        luma: the next one.
        points: places in OpenCV's pixels, whose centres are whole numbers [px].

    Returns:
        Where they are, and which of them came back and lie inside the picture (N,).
    """
    moved, found = _flow(previous, luma, points)
    back, returned = _flow(luma, previous, moved)
    kept = found & returned & _inside(moved, luma)
    return moved, kept & (np.linalg.norm(back - points, axis=1) < _BACK_PX)


def _light_change(first: UInt8, second: UInt8) -> float:
    """Mean change of the light of a grid's cells, 0 to 1."""
    cells = [cv2.resize(one, _CELLS, interpolation=cv2.INTER_AREA) for one in (first, second)]
    return float(cv2.absdiff(*cells).mean()) / 255.0


def _inside(points: Float32, luma: UInt8) -> Bool:
    height, width = luma.shape
    kept = (points > _MARGIN_PX - 1).all(axis=1) & (points[:, 0] < width - _MARGIN_PX)
    return np.asarray(kept & (points[:, 1] < height - _MARGIN_PX))


def _flow(first: UInt8, second: UInt8, points: Float32) -> tuple[Float32, Bool]:
    """Positions of points in the second picture (N, 2), and whether each was found (N,)."""
    moved, found, _ = cv2.calcOpticalFlowPyrLK(
        first, second, points.reshape(-1, 1, 2), points.reshape(-1, 1, 2).copy(),
        winSize=(_WINDOW_PX, _WINDOW_PX), maxLevel=_LEVELS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 0.01),
    )  # fmt: skip
    return np.asarray(moved, np.float32).reshape(-1, 2), np.asarray(found).reshape(-1) == 1
