"""Nodes of motion blur: how the object moves, samples over the shutter interval, line filter."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from nlens_video.core.box import Box
from nlens_video.core.layers import BlurredLayer, Float64, ObjectLayer
from nlens_video.effects.motion_blur import (
    MOST_MOMENTS,
    NEGLIGIBLE_SPAN_PX,
    Motion,
    affordable_moments,
    mean_layer,
    mean_of_blurred,
    measure_motion,
    motion_blurred,
)
from nlens_video.effects.motion_overscan import (
    beside,
    farthest_px,
    lens_beyond,
    overscan,
    strips,
)
from nlens_video.effects.motion_turn import turn_px, turned
from nlens_video.effects.planner import MOTION_BLUR
from nlens_video.graph.base.node import LARGEST_MOMENTS, Node
from nlens_video.graph.nodes.reblur import make_reblur
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, crop_to_frame, object_coc

if TYPE_CHECKING:
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.scene.camera import Camera
    from nlens_video.stages.l_reblur import ReblurLayer

_MOST_VERTICES = 1 << 14  # whose motion is measured


class MeasureMotion(Node):
    """Screen-space motion of the object's vertices over the shutter interval."""

    name, writes = "measure-motion", "motion"
    effect = MOTION_BLUR
    ranges = (("most_moments", 1, LARGEST_MOMENTS),)

    def __init__(self, context: NodeContext, *, most_moments: int = MOST_MOMENTS) -> None:
        self._objects, self._shutter = context.objects, context.shutter
        self._most_moments = most_moments
        self.description = (
            f"motion of vertices on screen, shutter {context.shutter.angle_deg:g} degrees"
        )

    def __call__(self, bounds: ScreenBounds, fit: LensFit | None) -> Motion | None:
        if self._objects.travel_bound_px(self._shutter.edges(bounds.time_s)) < NEGLIGIBLE_SPAN_PX:
            return None
        view = self._objects.view
        shutter = self._objects.shutter_at(self._shutter, bounds.time_s)
        seen = [
            self._objects.places(moment, _MOST_VERTICES) for moment in shutter.edges(bounds.time_s)
        ]
        known = followed([places for places in seen if places is not None], bounds.camera)
        if not known:
            return None
        disparity = np.array([1.0 / places[:, 2] for places in known], np.float32)
        coc_px = np.zeros(disparity.shape) if fit is None else fit.coc_px(disparity).astype(float)
        places = [one[:, :2] for one in known]
        affordable = affordable_moments(self._most_moments, places, view.box)
        motion = measure_motion(places, coc_px, self._most_moments, affordable)
        if motion is None:
            return None
        reach = 0.5 * float(np.abs(coc_px).max(initial=0.0)) * max(1.0, view.pixel_aspect)
        # one filter takes the layer of the middle, temporal samples those of the whole way
        rendered = places if len(motion.ways) > 1 else places[1:2]
        frame = view.box.expanded(view.overscan_px)
        if motion.turn is None:
            half_px = 0.5 * np.abs(motion.ways.mean(axis=0))
        else:
            half_px = np.full(2, 0.5 * turn_px(motion.turn, places[1]))
        box = overscan(rendered, half_px, reach, frame)
        beyond = []
        if len(motion.ways) == 1 and farthest_px(box, frame):
            around = math.ceil(min(reach, furthest_reach(view.pixel_aspect))) + 1
            for strip in strips(box, view.box):
                layer = self._objects.render_part(bounds, strip.expanded(around))
                if layer is not None:
                    beyond.append((strip, layer))
        return replace(motion, overscan=box, beyond=tuple(beyond))


def followed(seen: Sequence[Float64], camera: Camera) -> list[Float64]:
    """Those of some vertices whose motion counts; nothing where there are none.

    What passes close to the camera crosses any number of pixels far beyond the frame. So the
    vertices count that are within a frame's size of it half way, or all where none are.

    Args:
        seen: places of the vertices (V, 3) when the shutter opens, half way, and when it closes;
            NaN behind the camera.
        camera: tells the frame.
    """
    if not seen:
        return []
    before = np.isfinite([places[:, 2] for places in seen]).all(axis=0)
    near = before
    columns, rows, _ = seen[len(seen) // 2].T  # NumPy is slow along an axis of two
    for at, size in ((columns, camera.width), (rows, camera.height)):
        near = near & (at > -size) & (at < 2 * size)
    chosen = near if near.any() else before
    if chosen.all():
        return list(seen)
    return [places[chosen] for places in seen] if chosen.any() else []


class SelectSamples(Node):
    """The motion again where its parts move differently: temporal samples are rendered there."""

    name, writes = "select-samples", "moments"
    effect = MOTION_BLUR
    description = "temporal samples where parts of the object move differently"

    def __call__(self, motion: Motion) -> Motion | None:
        return motion if len(motion.ways) > 1 else None


class RenderMotion(Node):
    """Accumulation motion blur: the mean of temporal samples, each blurred by the lens."""

    name, writes = "render-motion", "blurred"
    effect = MOTION_BLUR

    def __init__(self, context: NodeContext) -> None:
        self._objects, self._shutter = context.objects, context.shutter
        self._reblur = make_reblur(context)
        self.description = "mean of temporal samples, blurred by the lens"

    def __call__(
        self, bounds: ScreenBounds, moments: Motion, layer: ObjectLayer | None, frame_box: Box,
        fit: LensFit | None,
    ) -> BlurredLayer:  # fmt: skip
        if layer is None and moments.overscan.empty:
            return BlurredLayer.nothing()
        view = self._objects.view
        farther = farthest_px(moments.overscan, view.box.expanded(view.overscan_px))
        box = frame_box.union(moments.overscan) if farther else frame_box
        lens = lens_beyond(self._reblur, frame_box, box) if farther else self._reblur
        shutter = self._objects.shutter_at(self._shutter, bounds.time_s)
        times = shutter.middles(bounds.time_s, len(moments.ways))

        def rendered(numbers: range) -> Iterator[ObjectLayer | None]:
            for number in numbers:
                if number == len(times) // 2 and not farther:
                    yield layer
                elif (there := self._objects.locate(0, times[number])) is None:
                    yield None
                else:
                    there = replace(there, plate_light=bounds.plate_light)
                    yield self._objects.render(there, fit, farther)

        layers = [
            _blurred(mean_layer(rendered(numbers)), lens, fit, box) for numbers in moments.parts
        ]
        mean = mean_of_blurred(layers, [len(numbers) for numbers in moments.parts])
        if moments.turn is not None:
            return turned(mean, moments.turn, frame_box, box)
        return motion_blurred(mean, moments.ways.mean(axis=0), frame_box, box)


def _blurred(
    layer: ObjectLayer | None, lens: ReblurLayer, fit: LensFit | None, box: Box
) -> BlurredLayer:
    """A sharp layer through the lens, cut to a box."""
    if layer is None:
        return BlurredLayer.nothing()
    if fit is not None:
        defocused = object_coc(layer, fit)
        if defocused.largest_coc_px >= NEGLIGIBLE_COC_PX:
            return lens(defocused, box)
    return crop_to_frame(layer, box)


class MotionBlur(Node):
    """Line-filter motion blur of the whole layer; not run where temporal samples were rendered.

    What the motion brings in from beyond the frame passes the lens here.
    """

    name, writes = "motion-blur", "blurred"
    effect, lane, skip_if = MOTION_BLUR, "composite", "moments"

    def __init__(self, context: NodeContext) -> None:
        self._reblur = make_reblur(context)
        self.description = "line filter along the mean motion"

    def __call__(
        self, blurred: BlurredLayer | None, motion: Motion, frame_box: Box, fit: LensFit | None
    ) -> BlurredLayer | None:
        way = motion.ways[0]
        if not motion.beyond:
            return blurred and motion_blurred(blurred, way, frame_box)
        parts = [
            _blurred(layer, lens_beyond(self._reblur, frame_box, strip), fit, strip)
            for strip, layer in motion.beyond
        ]
        whole = beside(blurred, frame_box, parts)
        return motion_blurred(whole, way, frame_box, motion.overscan)
