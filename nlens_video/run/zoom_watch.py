"""How much the plate grows or shrinks as a shot goes on, by points that are followed.

The GLB's camera is taken for the truth; this only tells whether the plate agrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32, Picture

_WIDTH = 240  # of what is looked at [px]
_POINTS, _FEWEST = 80, 24
_QUALITY, _SPACING_PX = 0.01, 6
_WINDOW_PX, _LEVELS = 21, 3
_WITHIN_PX = 1.0  # of where the motion of the whole puts a point


@dataclass(frozen=True, slots=True)
class Zoom:
    """The plate's size on one frame against the shot's first.

    Attributes:
        log_scale: logarithm of the ratio, above 0 where things have grown [1].
        shot: number of the stretch in which it can be told; from one to the next nothing is [1].
    """

    log_scale: float
    shot: int


class WatchZoom:
    """Looks at frames in order, some apart if need be.

    Points are followed from look to look, and compared with where they were at first; when too few
    are left, new ones are taken and the scale goes on from there. Where nothing can be followed (a
    cut, a plate without detail), another stretch begins.
    """

    def __init__(self) -> None:
        self._before: npt.NDArray[np.uint8] | None = None
        self._first: Float32 = np.empty((0, 1, 2), np.float32)  # points (N, 1, 2) [px]
        self._now: Float32 = self._first
        self._log_scale = self._since = 0.0
        self._shot = 0

    def __call__(self, picture: Picture) -> Zoom:
        """Look at a frame; it is left as it is."""
        seen = _small(picture)
        if self._before is not None and not self._follow(self._before, seen):
            self._shot += 1
            self._log_scale = 0.0
            self._take(seen)
        if len(self._now) < _FEWEST * 2:
            self._log_scale += self._since
            self._take(seen)
        self._before = seen
        return Zoom(self._log_scale + self._since, self._shot)

    def _take(self, seen: npt.NDArray[np.uint8]) -> None:
        found = cv2.goodFeaturesToTrack(seen, _POINTS, _QUALITY, _SPACING_PX)
        empty = np.empty((0, 1, 2), np.float32)
        self._first = self._now = empty if found is None else np.asarray(found, np.float32)
        self._since = 0.0

    def _follow(self, before: npt.NDArray[np.uint8], seen: npt.NDArray[np.uint8]) -> bool:
        """Where the points are now, and how far apart they have come; False where they are lost."""
        if len(self._now) < _FEWEST:
            return False
        moved, held, _ = cv2.calcOpticalFlowPyrLK(
            before,
            seen,
            self._now,
            self._now.copy(),
            winSize=(_WINDOW_PX, _WINDOW_PX),
            maxLevel=_LEVELS,
        )
        kept = held[:, 0] == 1
        first, now = self._first[kept], moved[kept]
        if len(now) < _FEWEST:
            return False
        matrix, fits = cv2.estimateAffinePartial2D(
            first, now, ransacReprojThreshold=_WITHIN_PX, maxIters=200
        )
        if matrix is None or fits.sum() < _FEWEST:
            return False
        self._first, self._now = first[fits[:, 0] == 1], now[fits[:, 0] == 1]
        self._since = float(np.log(max(np.hypot(matrix[0, 0], matrix[1, 0]), 1e-6)))
        return True


def _small(picture: Picture) -> npt.NDArray[np.uint8]:
    """Green, coded as the root of light (h, w)."""
    width = min(_WIDTH, picture.width)
    height = max(1, round(picture.height * width / picture.width))
    light: Float32 = picture.reduced(width, height)[..., 1]
    return np.asarray(np.sqrt(np.clip(light, 0.0, 1.0)) * 255.0, np.uint8)
