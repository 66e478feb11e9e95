"""How much the positions of followed points tremble, whatever the camera does."""

from __future__ import annotations

import cv2
import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.solve.points.observations import Ints, Observations

_TRIPLES = 16  # of frames that are compared
_FEWEST = 12  # points that three frames share
_OF_THREE = 6.0**0.5  # spread of one position less twice the next and the one after


def noise_px(seen: Observations, first: int, last: int) -> float:
    """Median distance of a position from where it would be without noise, 0 where unknown [px].

    Three frames in a row are compared: what differs between the homography of the first two and
    that of the last two is noise, while depth makes the same difference to both.

    Args:
        seen: where points were seen.
        first: frame of a part of the shot.
        last: its last frame.
    """
    found = []
    for frame in range(first + 1, last, max(1, (last - first) // _TRIPLES)):
        shown = [seen.frame(frame + step) for step in (-1, 0, 1)]
        names = np.intersect1d(np.intersect1d(shown[0][0], shown[1][0]), shown[2][0])
        if len(names) < _FEWEST:
            continue
        before, here, after = (_of(names, *one) for one in shown)
        moved = [_carried(here, other) for other in (before, after)]
        if moved[0] is not None and moved[1] is not None:
            off = before - moved[0] + after - moved[1]
            found.append(np.median(np.linalg.norm(off, axis=1)) / _OF_THREE)
    return float(np.median(found)) if found else 0.0


def _of(names: Ints, numbers: Ints, pixels: Float64) -> Float64:
    """Positions of some points (N, 2) [px]."""
    return np.asarray(pixels[np.intersect1d(names, numbers, return_indices=True)[2]])


def _carried(one: Float64, other: Float64) -> Float64 | None:
    """Where the homography that fits best takes points (N, 2) [px]."""
    matrix, _ = cv2.findHomography(one, other, cv2.LMEDS)
    if matrix is None:
        return None
    return np.asarray(cv2.perspectiveTransform(one[:, None], matrix)[:, 0], np.float64)
