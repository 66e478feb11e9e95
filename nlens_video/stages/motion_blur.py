"""Motion blur: the object at some moments while the shutter is open, each through the lens.

Shutter and lens average light over time and over the aperture. What the whole object does on the
screen, one picture shows when it is smeared along the way; what its parts do differently takes
pictures of several moments, each smeared over its share of the time. So curved paths, turning
parts and a change of focus on the way come out right, and a rigid slide costs one filter. (Velocity
vectors by pixel, the usual shortcut, are wrong wherever the silhouette changes.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np

from nlens_video.frames import BlurredLayer, Box, Float32, Float64, ObjectLayer

NEGLIGIBLE_SPAN_PX = 1.0
MOST_MOMENTS = 33
_STEP_PX = 2.0
_SUB_STEPS = 8  # places by pixel of way that a smear is measured at


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """What an object does on the screen while the shutter is open.

    Attributes:
        span_px: way of its fastest vertex [px].
        spread_px: most that a vertex moves differently from the mean of all [px].
        ways: mean way of the vertices in each of an odd number of equal parts of the time,
            columns and rows (K, 2) [px].
    """

    span_px: float
    spread_px: float
    ways: Float64


def moment_count(spread_px: float, coc_px: float, most: int = MOST_MOMENTS) -> int:
    """How many moments a motion takes, an odd number, so that they are not told apart.

    Discs of a CoC hide steps of half of it; what is sharp takes a picture every two pixels, since
    each is smeared along the mean way and only the fastest parts differ from that so much.

    Args:
        spread_px: most that a vertex moves differently from the mean [px].
        coc_px: least CoC diameter of the object [px].
        most: limit of the count.
    """
    count = math.ceil(spread_px / max(_STEP_PX, 0.5 * coc_px)) if spread_px > 0.5 else 1
    return min(count + (count + 1) % 2, most - (most + 1) % 2)


def measure_motion(
    places: Callable[[float], Float64 | None],
    edges: tuple[float, float, float],
    coc_px: float,
    most: int = MOST_MOMENTS,
) -> Motion | None:
    """See how an object moves while the shutter is open.

    Args:
        places: its vertices on the frame (V, 2) at a time [px], None where that is not known.
        edges: when the shutter opens, is half through, and closes [s].
        coc_px: least CoC diameter of the object [px].
        most: limit of the number of moments.

    Returns:
        The motion; None where it is negligible or not known.
    """
    seen = [places(moment) for moment in edges]
    if any(there is None or not len(there) for there in seen):
        return None
    opening, middle, closing = (np.asarray(there) for there in seen)
    halves = (middle - opening, closing - middle)
    span = float(sum(np.linalg.norm(half, axis=1) for half in halves).max())
    if span < NEGLIGIBLE_SPAN_PX:
        return None
    spread = sum(_spread(half) for half in halves)
    count = moment_count(spread, coc_px, most)
    start, half_way, end = (part.mean(axis=0) for part in (opening, middle, closing))
    # the mean's way is a parabola through its three places
    at = np.linspace(-1.0, 1.0, count + 1)[:, None]
    centres = half_way + 0.5 * at * (end - start) + 0.5 * at**2 * (start + end - 2.0 * half_way)
    return Motion(span_px=span, spread_px=spread, ways=np.diff(centres, axis=0))


def _spread(ways: Float64) -> float:
    return float(np.linalg.norm(ways - ways.mean(axis=0), axis=1).max())


def smeared(layer: BlurredLayer, way_px: Float64, frame: Box) -> BlurredLayer:
    """A layer moved evenly along a straight way, half of it before and half after its own place.

    Args:
        layer: premultiplied, inside the frame.
        way_px: columns and rows (2,) [px].
        frame: the frame's own box.
    """
    kernel = way_kernel(way_px)
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


def way_kernel(way_px: Float64) -> Float32:
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


def through_shutter(
    moments: Iterable[ObjectLayer | None],
    ways: Float64,
    blur: Callable[[ObjectLayer], BlurredLayer],
    frame: Box,
) -> BlurredLayer:
    """The mean of an object's pictures at some moments, each smeared over its share of the time.

    Args:
        moments: the sharp layers in order; drawn on this thread, one at a time; None among them
            is an object out of view.
        ways: way that each is smeared along (K, 2) [px].
        blur: what the lens makes of one; runs on another thread.
        frame: the frame's own box.

    Returns:
        Premultiplied scene-linear, on the pixels that any of them reach.
    """
    total = np.zeros((frame.height, frame.width, 4), np.float32)
    share = np.float32(1.0 / len(ways))
    reached: list[Box] = []

    def add(layer: ObjectLayer, way_px: Float64) -> None:
        part = smeared(blur(layer), way_px, frame)
        if not part.box.empty:
            total[part.box.slices_in(frame)] += share * part.rgba
            reached.append(part.box)

    # While OpenGL draws one moment another is blurred; they are added in order.
    with ThreadPoolExecutor(1, thread_name_prefix="shutter") as blurring:
        before: Future[None] | None = None
        for layer, way_px in zip(moments, ways, strict=True):
            if before is not None:
                before.result()
            before = blurring.submit(add, layer, way_px) if layer is not None else None
        if before is not None:
            before.result()
    if not reached:
        return BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
    box = reduce(Box.joined, reached)
    return BlurredLayer(box=box, rgba=total[box.slices_in(frame)])
