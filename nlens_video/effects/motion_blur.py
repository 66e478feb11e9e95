"""Motion blur: accumulation of temporal samples over the shutter interval, and a line filter.

Shutter and lens integrate light over time and over the aperture. A motion of the whole object is a
line filter on one picture; a motion that differs between its parts takes several temporal samples,
each filtered over its share of the interval. So curved paths, turning parts and a change of focus
on the way come out right, and a rigid slide costs one filter. (Velocity vectors by pixel, the usual
shortcut, are wrong wherever the silhouette changes.)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import reduce
from itertools import pairwise

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.box import Int64
from nlens_video.core.layers import BlurredLayer, Box, Float32, Float64, ObjectLayer
from nlens_video.effects.motion_turn import shared_turn
from nlens_video.scene.posed import bounds_of

NEGLIGIBLE_SPAN_PX = 1.0
MOST_MOMENTS = 33
_STEP_PX = 2.0
_REFOCUS_PX = 1.5  # largest change of the CoC that one blur of the mean stands for [px]
_NEAREST = 1e-9  # least depth, against division by 0 [scene unit]
_SAMPLED_STEP_PX = 4.0  # what lies on the ground is soft or faint
_SUB_STEPS = 8  # samples of the line filter by pixel
_NOTHING = Box(0, 0, 0, 0)
_FULL_HD_PX = 1920 * 1080
_MOST_TIMES = 4.0  # so many samples are taken of what is small, for one of what fills the frame


class Motion(Struct, frozen=True, kw_only=True):
    """Motion of an object on the screen while the shutter is open.

    Attributes:
        span_px: path of its fastest vertex [px].
        spread_px: largest difference of a vertex's motion from the mean [px].
        refocus_px: largest change of the CoC diameter of a vertex [px].
        ways: mean motion of the vertices in each of an odd number of equal parts of the interval,
            columns and rows (K, 2) [px].
        overscan: the frame and what is rendered beside it, empty where the object stays out of it.
        turn: from one sample to the next, as of `shared_turn`, where more samples would be needed
            than are taken; it stands in for the ways.
        beyond: strips beside the frame of which the filter brings something in, each with the sharp
            object as far around it as the lens spreads it.
    """

    span_px: float
    spread_px: float
    refocus_px: float
    ways: Float64
    turn: Float64 | None = None
    overscan: Box = _NOTHING
    beyond: tuple[tuple[Box, ObjectLayer], ...] = ()

    @property
    def parts(self) -> list[range]:
        """Temporal samples whose mean the lens blurs at once: all, unless the CoC changes."""
        count = len(self.ways)
        wanted = min(count, max(1, math.ceil(self.refocus_px / _REFOCUS_PX)))
        ends = [round(count * part / wanted) for part in range(wanted + 1)]
        return [range(*pair) for pair in pairwise(ends)]


def moment_count(
    spread_px: Float64 | float, coc_px: Float64 | float, most: int = MOST_MOMENTS
) -> int:
    """Number of temporal samples that a motion takes without visible steps; odd.

    Discs of a CoC hide steps of half of it; a sharp object takes a sample every two pixels, since
    each is filtered along the mean motion and only the fastest parts differ from that so much.

    Args:
        spread_px: differences of vertices' motion from the mean (V,) [px].
        coc_px: their least CoC diameters (V,), without sign [px].
        most: limit.
    """
    steps = spread_px / np.maximum(_STEP_PX, 0.5 * coc_px)
    count = math.ceil(float(np.max(steps))) if np.max(spread_px) > 0.5 else 1
    return _odd(count, most)


def sampled_count(
    places: Sequence[Float64], coc_px: Float64 | float, most: int = MOST_MOMENTS
) -> int:
    """Number of temporal samples of a motion that is not filtered; odd, 1 where it is negligible.

    Args:
        places: positions on the frame (V, 2) when the shutter opens, half way, and when it closes
            [px].
        coc_px: their CoC diameters (V,), or the least of them, without sign [px].
        most: limit.
    """
    span = _path_px(_halves(places)[1])
    if float(span.max(initial=0.0)) < NEGLIGIBLE_SPAN_PX:
        return 1
    steps = span / np.maximum(_SAMPLED_STEP_PX, 0.5 * coc_px)
    return _odd(math.ceil(float(steps.max())), most)


def _odd(count: int, most: int) -> int:
    """The next odd number, or the last one up to a limit."""
    return min(count + (count + 1) % 2, most - (most + 1) % 2)


def _path_px(halves: Float64) -> Float64:
    """Length of a path of two parts (2, 2, V), their columns and rows: (V,) [px]."""
    first, second = np.sqrt(halves[:, 0] * halves[:, 0] + halves[:, 1] * halves[:, 1])
    return np.asarray(first + second)


def _halves(places: Sequence[Float64]) -> tuple[Float64, Float64]:
    """Three places of points, columns and rows (3, 2, V), and the ways between them (2, 2, V).

    Along memory, for NumPy is slow along an axis of two.
    """
    along = np.array([one.T for one in places], order="C")
    return along, along[1:] - along[:-1]


def affordable_moments(most: int, places: Sequence[Float64], frame: Box) -> int:
    """As many temporal samples of an object as cost what the limit does where it fills full HD.

    Args:
        most: limit for such an object.
        places: positions of vertices (V, 2) while the shutter is open [px].
        frame: the frame's own box.
    """
    low, high = bounds_of(np.concatenate(places))
    low = np.clip(low, (frame.x0, frame.y0), None)
    high = np.clip(high, None, (frame.x1, frame.y1))
    area = max(1.0, float(np.prod(np.maximum(high - low, 0.0))))
    return int(most * min(max(1.0, _FULL_HD_PX / area), _MOST_TIMES))


def measure_motion(
    places: Sequence[Float64], coc_px: Float64, most: int = MOST_MOMENTS, affordable: int = 0
) -> Motion | None:
    """Motion of an object while the shutter is open; None where it is negligible.

    Args:
        places: its vertices on the frame (V, 2) when the shutter opens, half way, and when it
            closes [px].
        coc_px: their signed CoC diameters then (3, V), 0 where the lens is not known [px].
        most: limit of the number of temporal samples.
        affordable: limit instead of that where no one map moves all vertices, if it is higher.
    """
    along, halves = _halves(places)
    span = float(_path_px(halves).max(initial=0.0))
    if span < NEGLIGIBLE_SPAN_PX:
        return None
    spread = _path_px(halves - halves.mean(axis=2, keepdims=True))
    least_coc = np.abs(coc_px).min(axis=0)
    count, turn = moment_count(spread, least_coc, most), None
    wanted = moment_count(spread, least_coc, max(most, affordable)) if count > 1 else count
    if wanted > count:
        turn = shared_turn(places, count)
        count = wanted if turn is None else count
    start, half_way, end = along.mean(axis=2)
    # the mean's path is a parabola through its three positions
    at = np.linspace(-1.0, 1.0, count + 1)[:, None]
    centres = half_way + 0.5 * at * (end - start) + 0.5 * at**2 * (start + end - 2.0 * half_way)
    return Motion(
        span_px=span,
        spread_px=float(spread.max()),
        refocus_px=float(np.ptp(coc_px, axis=0).max()),
        ways=np.diff(centres, axis=0),
        turn=turn,
    )


def motion_blurred(
    layer: BlurredLayer, way_px: Float64, frame: Box, known: Box = _NOTHING
) -> BlurredLayer:
    """A layer filtered along a straight line that is centred on it.

    Args:
        layer: premultiplied, inside the frame or `known`.
        way_px: columns and rows (2,) [px].
        frame: the frame's own box, which bounds the result.
        known: where the layer is whole, if that is more than the frame.
    """
    kernel = line_kernel(way_px, (frame.width, frame.height))
    rows, columns = (side // 2 for side in kernel.shape)
    held = layer.box
    if held.empty or not (rows or columns):
        return layer
    known = known.union(frame)
    wide = Box(held.x0 - columns, held.y0 - rows, held.x1 + columns, held.y1 + rows)
    box = wide.intersection(frame)
    if box.empty:
        return BlurredLayer.nothing()
    source = cv2.copyMakeBorder(
        layer.rgba, rows, rows, columns, columns, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0)
    )
    # beyond what is known the layer is extended
    if held.x0 == known.x0:
        source[:, :columns] = source[:, columns : columns + 1]
    if held.x1 == known.x1 and columns:
        source[:, -columns:] = source[:, -columns - 1 : -columns]
    if held.y0 == known.y0:
        source[:rows] = source[rows : rows + 1]
    if held.y1 == known.y1 and rows:
        source[-rows:] = source[-rows - 1 : -rows]
    out = cv2.filter2D(source, -1, kernel, borderType=cv2.BORDER_CONSTANT)
    return BlurredLayer(box=box, rgba=np.ascontiguousarray(out[box.slices_in(wide)]))


def line_kernel(way_px: Float64, most_px: tuple[int, int] | None = None) -> Float32:
    """Line filter (2 * rows + 1, 2 * columns + 1) of a motion in columns and rows [px].

    The sum is 1; less where the motion goes on beyond `most_px` columns or rows on each side, which
    are left out. So the filter's size is bounded by the frame's.
    """
    steps = max(1, math.ceil(_SUB_STEPS * float(np.abs(way_px).max())))
    places = np.arange(steps) if most_px is None else _within(steps, way_px, most_px)
    along = ((places + 0.5) / steps - 0.5)[:, None] * way_px
    columns, rows = (math.ceil(0.5 * abs(float(way)) - 1e-9) for way in way_px)
    if most_px is not None:
        columns, rows = min(columns, most_px[0]), min(rows, most_px[1])
    kernel = np.zeros((2 * rows + 3, 2 * columns + 3))
    left, top = np.floor(along).astype(np.intp).T
    right_share, low_share = (along - np.floor(along)).T
    for down, row_share in ((0, 1.0 - low_share), (1, low_share)):
        for across, column_share in ((0, 1.0 - right_share), (1, right_share)):
            at = (top + down + rows + 1, left + across + columns + 1)
            np.add.at(kernel, at, row_share * column_share / steps)
    return kernel[1:-1, 1:-1].astype(np.float32)


def _within(steps: int, way_px: Float64, most_px: tuple[int, int]) -> Int64:
    """Those of equal steps of a way, centred on 0, that lie at most so many pixels off 0 [px]."""
    share = min(
        1.0,
        *(
            2.0 * most / max(abs(float(way)), 1e-9)
            for most, way in zip(most_px, way_px, strict=True)
        ),
    )
    half = 0.5 * share * steps
    return np.arange(math.ceil(0.5 * steps - half), math.floor(0.5 * steps + half))


def mean_layer(layers: Iterable[ObjectLayer | None]) -> ObjectLayer | None:
    """The mean of an object's sharp pictures, to be blurred by the lens at once.

    Only where parts of different CoC cross one pixel do both get the mean of the two.

    Args:
        layers: in any order, each held no longer than needed; None: out of view at that moment.

    Returns:
        Premultiplied mean; disparity is the mean by coverage. None: never in view.
    """
    held, count = Box(0, 0, 0, 0), 0
    rgba, known = np.zeros((0, 0, 4), np.float32), np.zeros((2, 0, 0), np.float32)
    for layer in layers:
        count += 1
        if layer is None:
            continue
        box = held.union(layer.box)
        if box != held:
            wider = np.zeros((box.height, box.width, 4), np.float32)
            known_there = np.zeros((2, box.height, box.width), np.float32)
            if not held.empty:
                wider[held.slices_in(box)] = rgba
                known_there[(slice(None), *held.slices_in(box))] = known
            held, rgba, known = box, wider, known_there
        at = layer.box.slices_in(held)
        rgba[at] += layer.rgba
        coverage = layer.rgba[..., 3] * np.isfinite(layer.depth)
        known[0][at] += coverage
        known[1][at] += coverage / np.maximum(layer.depth, np.float32(_NEAREST))
    if held.empty:
        return None
    depth = np.full(known.shape[1:], np.inf, np.float32)
    np.divide(known[0], known[1], where=known[1] > 0.0, out=depth)
    return ObjectLayer(box=held, rgba=rgba / np.float32(count), depth=depth)


def mean_of_blurred(layers: Sequence[BlurredLayer], counts: Sequence[int]) -> BlurredLayer:
    """The mean of blurred layers inside the frame, weighted by their numbers of samples."""
    if len(layers) == 1:
        return layers[0]
    box = reduce(Box.union, (layer.box for layer in layers))
    total = np.zeros((box.height, box.width, 4), np.float32)
    for layer, count in zip(layers, counts, strict=True):
        total[layer.box.slices_in(box)] += np.float32(count / sum(counts)) * layer.rgba
    return BlurredLayer(box=box, rgba=total)
