"""Motion blur between temporal samples of an object that turns, grows or leans as a whole.

Such a motion is one affine map of the screen that goes on all the time, so the light between two
samples is that of their mean, moved along by parts of the map: rotation takes a fan of few samples
to an even arc, as the line filter does for a slide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float64

_OFF_PX = 0.5  # by which a vertex may be off its own path between two samples [px]
_STEP_PX = 1.0  # from one moved picture to the next
_MOST_STEPS = 64
_ROOTS, _TERMS = 40, 12  # of the logarithm, with more than enough for float64
_NEAR = 0.1  # to the identity, where series take few terms


def shared_turn(places: Sequence[Float64], count: int) -> Float64 | None:
    """The map of a temporal sample to the next that all vertices share; None where they do not.

    Args:
        places: positions on the frame (V, 2) when the shutter opens, half way, and when it closes
            [px].
        count: number of temporal samples.

    Returns:
        Its logarithm (3, 3), of positions as columns (x, y, 1): times a share, it is that of the
        part of the way.
    """
    start, middle, end = (np.column_stack([one, np.ones(len(one))]) for one in places)
    centre = middle[:, :2].mean(axis=0)
    size = float(np.abs(middle[:, :2] - centre).max(initial=0.0))
    if size <= 0.0:
        return None
    # coordinates of about 1, which keeps the fits well conditioned
    own = np.array([[1.0 / size, 0.0, -centre[0] / size], [0.0, 1.0 / size, -centre[1] / size]])
    own = np.vstack([own, [0.0, 0.0, 1.0]])
    start, middle, end = (one @ own.T for one in (start, middle, end))
    forth, back = (np.linalg.lstsq(middle, one, rcond=1e-6) for one in (end, start))
    if forth[2] < 3:  # vertices on a line tell no map
        return None
    with np.errstate(all="ignore"):
        try:
            half = 0.5 * (_logarithm(forth[0].T) - _logarithm(back[0].T))
        except np.linalg.LinAlgError:
            return None
        off = [
            np.abs(middle @ exponential(sign * half).T - one).max()
            for sign, one in ((1.0, end), (-1.0, start))
        ]
    if not max(off) * size <= _OFF_PX * count:  # nor what is not a number
        return None
    return np.asarray(np.linalg.inv(own) @ half @ own * (2.0 / count))


def turn_px(turn: Float64, places: Float64) -> float:
    """The longest way that a map takes one of some positions (V, 2), by its logarithm [px]."""
    return float(np.hypot(*(turn[:2, :2] @ places.T + turn[:2, 2:])).max())


def turned(layer: BlurredLayer, turn: Float64, frame: Box, known: Box) -> BlurredLayer:
    """The mean of a layer over a map that is centred on it.

    Args:
        layer: premultiplied, inside `known`.
        turn: logarithm of the map, as of `shared_turn`.
        frame: the frame's own box, which bounds the result.
        known: where the layer is whole; beyond it, it is extended.
    """
    held = layer.box
    if held.empty:
        return layer
    corners = np.array([(x, y) for x in (held.x0, held.x1) for y in (held.y0, held.y1)], np.float64)
    steps = min(max(1, math.ceil(turn_px(turn, corners) / _STEP_PX)), _MOST_STEPS)
    maps = [exponential(((step + 0.5) / steps - 0.5) * turn)[:2] for step in range(steps)]
    places = np.concatenate([corners @ one[:, :2].T + one[:, 2] for one in maps])
    low, high = np.floor(places.min(axis=0)) - 1.0, np.ceil(places.max(axis=0)) + 1.0
    low, high = (np.clip(one, -1e6, 1e6) for one in (low, high))
    box = Box(*map(int, low), *map(int, high)).intersection(frame)
    if box.empty:
        return BlurredLayer.nothing()
    # nothing is beside the layer but at the border of what is known
    top, bottom = int(held.y0 > known.y0), int(held.y1 < known.y1)
    left, right = int(held.x0 > known.x0), int(held.x1 < known.x1)
    source = cv2.copyMakeBorder(
        layer.rgba, top, bottom, left, right, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0)
    )
    corner = np.array([held.x0 - left, held.y0 - top]) + 0.5
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    for one in maps:
        shift = one[:, :2] @ corner + one[:, 2] - (box.x0 + 0.5, box.y0 + 0.5)
        rgba += cv2.warpAffine(
            source, np.column_stack([one[:, :2], shift]), (box.width, box.height),
            flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
    rgba /= np.float32(steps)
    return BlurredLayer(box=box, rgba=rgba)


def exponential(matrix: Float64) -> Float64:
    """The exponential of a matrix (N, N)."""
    size = float(np.abs(matrix).sum())
    halvings = max(0, math.ceil(math.log2(size / _NEAR))) if size > _NEAR else 0
    part = matrix / 2.0**halvings
    term = result = np.eye(len(matrix))
    for number in range(1, _TERMS):
        term = term @ part / number
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result)


def _logarithm(matrix: Float64) -> Float64:
    """The logarithm of a matrix (N, N), by square roots until it is close to the identity.

    Raises:
        LinAlgError: it has none, such as that of a mirror.
    """
    one, roots = np.eye(len(matrix)), 0
    while not np.abs(matrix - one).sum() <= _NEAR:
        if roots == _ROOTS:
            raise np.linalg.LinAlgError("no logarithm")
        matrix, roots = _root(matrix), roots + 1
    off = matrix - one
    term, result = one, np.zeros_like(one)
    for number in range(1, 2 * _TERMS):
        term = term @ off
        result = result + (-1.0) ** (number + 1) / number * term
    return np.asarray(2.0**roots * result)


def _root(matrix: Float64) -> Float64:
    """The square root of a matrix without negative eigenvalues (Denman and Beavers 1976)."""
    root, inverse = matrix, np.eye(len(matrix))
    for _ in range(_ROOTS):
        root, inverse = (
            0.5 * (root + np.linalg.inv(inverse)),
            0.5 * (inverse + np.linalg.inv(root)),
        )
    return root
