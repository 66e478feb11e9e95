"""Motion blur: the object at some moments while the shutter is open, through the lens.

Shutter and lens average light over time and over the aperture. What the whole object does on the
screen, one picture shows when it is smeared along the way; what its parts do differently takes
pictures of several moments, each smeared over its share of the time. So curved paths, turning
parts and a change of focus on the way come out right, and a rigid slide costs one filter. (Velocity
vectors by pixel, the usual shortcut, are wrong wherever the silhouette changes.)
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32, Float64, ObjectLayer

NEGLIGIBLE_SPAN_PX = 1.0
MOST_MOMENTS = 33
_STEP_PX = 2.0
_REFOCUS_PX = 1.5  # a change of the CoC that one blur of the mean does not show [px]
_NEAREST = 1e-9  # a depth, so that nothing is divided by 0 [scene unit]
_SAMPLED_STEP_PX = 4.0  # what lies on the ground is soft or faint
_SUB_STEPS = 8  # places by pixel of way that a smear is measured at


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """What an object does on the screen while the shutter is open.

    Attributes:
        span_px: way of its fastest vertex [px].
        spread_px: most that a vertex moves differently from the mean of all [px].
        refocus_px: most that the CoC diameter of a vertex changes [px].
        ways: mean way of the vertices in each of an odd number of equal parts of the time,
            columns and rows (K, 2) [px].
    """

    span_px: float
    spread_px: float
    refocus_px: float
    ways: Float64

    @property
    def parts(self) -> list[range]:
        """Numbers of the moments whose mean goes through the lens at once.

        All of them, unless the blur itself changes meanwhile.
        """
        count = len(self.ways)
        wanted = min(count, max(1, math.ceil(self.refocus_px / _REFOCUS_PX)))
        ends = [round(count * part / wanted) for part in range(wanted + 1)]
        return [range(*pair) for pair in pairwise(ends)]


def moment_count(
    spread_px: Float64 | float, coc_px: Float64 | float, most: int = MOST_MOMENTS
) -> int:
    """How many moments a motion takes, an odd number, so that they are not told apart.

    Discs of a CoC hide steps of half of it; what is sharp takes a picture every two pixels, since
    each is smeared along the mean way and only the fastest parts differ from that so much.

    Args:
        spread_px: what vertices move differently from the mean (V,) [px].
        coc_px: least CoC diameters of theirs (V,), without sign [px].
        most: limit of the count.
    """
    told_apart = spread_px / np.maximum(_STEP_PX, 0.5 * coc_px)
    count = math.ceil(float(np.max(told_apart))) if np.max(spread_px) > 0.5 else 1
    return _odd(count, most)


def _odd(count: int, most: int) -> int:
    """The next odd number, or the last one up to a limit."""
    return min(count + (count + 1) % 2, most - (most + 1) % 2)


def measure_motion(
    places: Sequence[Float64], coc_px: Float64, most: int = MOST_MOMENTS
) -> Motion | None:
    """See how an object moves while the shutter is open.

    Args:
        places: its vertices on the frame (V, 2) when the shutter opens, is half through, and closes
            [px].
        coc_px: their signed CoC diameters then (3, V), 0 where the lens is not known [px].
        most: limit of the number of moments.

    Returns:
        The motion; None where it is negligible.
    """
    opening, middle, closing = places
    halves = (middle - opening, closing - middle)
    span = float(sum(np.linalg.norm(half, axis=1) for half in halves).max(initial=0.0))
    if span < NEGLIGIBLE_SPAN_PX:
        return None
    spread = sum(np.linalg.norm(half - half.mean(axis=0), axis=1) for half in halves)
    count = moment_count(spread, np.abs(coc_px).min(axis=0), most)
    start, half_way, end = (part.mean(axis=0) for part in places)
    # the mean's way is a parabola through its three places
    at = np.linspace(-1.0, 1.0, count + 1)[:, None]
    centres = half_way + 0.5 * at * (end - start) + 0.5 * at**2 * (start + end - 2.0 * half_way)
    return Motion(
        span_px=span,
        spread_px=float(spread.max()),
        refocus_px=float(np.ptp(coc_px, axis=0).max()),
        ways=np.diff(centres, axis=0),
    )


def sampled_count(
    places: Sequence[Float64], coc_px: Float64 | float, most: int = MOST_MOMENTS
) -> int:
    """How many moments show a motion that is not smeared, an odd number; 1: it is negligible.

    Args:
        places: of what moves, on the frame (V, 2), when the shutter opens, is half through, and
            closes [px].
        coc_px: its CoC diameters (V,), or the least of them, without sign [px].
        most: limit of the count.
    """
    opening, middle, closing = places
    halves = (middle - opening, closing - middle)
    span: Float64 = np.asarray(sum(np.linalg.norm(half, axis=1) for half in halves))
    if float(span.max(initial=0.0)) < NEGLIGIBLE_SPAN_PX:
        return 1
    told_apart = span / np.maximum(_SAMPLED_STEP_PX, 0.5 * coc_px)
    return _odd(math.ceil(float(told_apart.max())), most)


def motion_blurred(layer: BlurredLayer, way_px: Float64, frame: Box) -> BlurredLayer:
    """A layer moved evenly along a straight way, half of it before and half after its own place.

    Args:
        layer: premultiplied, inside the frame.
        way_px: columns and rows (2,) [px].
        frame: the frame's own box.
    """
    kernel = line_kernel(way_px)
    rows, columns = (side // 2 for side in kernel.shape)
    if layer.box.empty or not (rows or columns):
        return layer
    held = layer.box
    wide = Box(held.x0 - columns, held.y0 - rows, held.x1 + columns, held.y1 + rows)
    box = wide.intersection(frame)
    source = cv2.copyMakeBorder(
        layer.rgba, rows, rows, columns, columns, cv2.BORDER_CONSTANT, value=(0, 0, 0, 0)
    )
    # a picture that the frame cuts goes on beyond it, as far as one can tell
    if held.x0 == frame.x0:
        source[:, :columns] = source[:, columns : columns + 1]
    if held.x1 == frame.x1 and columns:
        source[:, -columns:] = source[:, -columns - 1 : -columns]
    if held.y0 == frame.y0:
        source[:rows] = source[rows : rows + 1]
    if held.y1 == frame.y1 and rows:
        source[-rows:] = source[-rows - 1 : -rows]
    out = cv2.filter2D(source, -1, kernel, borderType=cv2.BORDER_CONSTANT)
    return BlurredLayer(box=box, rgba=np.ascontiguousarray(out[box.slices_in(wide)]))


def line_kernel(way_px: Float64) -> Float32:
    """Weights of an even motion along a straight way, (2 * rows + 1, 2 * columns + 1), sum 1.

    Args:
        way_px: columns and rows (2,) [px].
    """
    steps = max(1, math.ceil(_SUB_STEPS * float(np.abs(way_px).max())))
    along = ((np.arange(steps) + 0.5) / steps - 0.5)[:, None] * way_px
    columns, rows = (math.ceil(0.5 * abs(float(way)) - 1e-9) for way in way_px)
    kernel = np.zeros((2 * rows + 3, 2 * columns + 3))
    left, top = np.floor(along).astype(np.intp).T
    right_share, low_share = (along - np.floor(along)).T
    for down, row_share in ((0, 1.0 - low_share), (1, low_share)):
        for across, column_share in ((0, 1.0 - right_share), (1, right_share)):
            at = (top + down + rows + 1, left + across + columns + 1)
            np.add.at(kernel, at, row_share * column_share / steps)
    return kernel[1:-1, 1:-1].astype(np.float32)


def mean_layer(layers: Iterable[ObjectLayer | None]) -> ObjectLayer | None:
    """The mean of an object's sharp pictures at some moments.

    What is blurred later is blurred once: discs add up as light does. Only where parts of another
    CoC cross one pixel in the meantime do both get the mean of the two.

    Args:
        layers: in any order, each held no longer than it takes; None: out of view at that moment.

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
    """The mean of blurred pictures that stand for so many moments each.

    Args:
        layers: premultiplied, each inside the frame.
        counts: moments of each.
    """
    if len(layers) == 1:
        return layers[0]
    box = reduce(Box.union, (layer.box for layer in layers))
    total = np.zeros((box.height, box.width, 4), np.float32)
    for layer, count in zip(layers, counts, strict=True):
        total[layer.box.slices_in(box)] += np.float32(count / sum(counts)) * layer.rgba
    return BlurredLayer(box=box, rgba=total)
