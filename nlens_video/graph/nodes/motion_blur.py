"""The nodes of motion blur."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.box import Box
from nlens_video.core.layers import BlurredLayer, ObjectLayer
from nlens_video.effects.motion_blur import (
    MOST_MOMENTS,
    NEGLIGIBLE_SPAN_PX,
    Motion,
    averaged,
    mean_of_blurred,
    measure_motion,
    smeared,
)
from nlens_video.effects.planner import MOTION_BLUR
from nlens_video.graph.base.node import Node
from nlens_video.graph.nodes import warm_up
from nlens_video.graph.nodes.reblur import make_reblur
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX, crop_to_frame, object_coc

if TYPE_CHECKING:
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.object_source import ScreenBounds


class MeasureMotion(Node):
    """The object's motion on the screen while the shutter is open."""

    name, writes = "measure-motion", "motion"
    effect = MOTION_BLUR

    def __init__(self, context: NodeContext, *, most_moments: int = MOST_MOMENTS) -> None:
        self._objects, self._shutter = context.objects, context.shutter
        self._most_moments = most_moments
        self.description = f"vertices on the screen, shutter {context.shutter.angle_deg:g} degrees"

    def __call__(self, bounds: ScreenBounds, fit: LensFit | None) -> Motion | None:
        moments = self._shutter.edges(bounds.time_s)
        if self._objects.travel_bound_px(moments) < NEGLIGIBLE_SPAN_PX:
            return None
        seen = [self._objects.places(moment) for moment in moments]
        known = [places for places in seen if places is not None and len(places)]
        if len(known) < len(seen):
            return None
        disparity = np.array([1.0 / places[:, 2] for places in known], np.float32)
        coc_px = np.zeros(disparity.shape) if fit is None else fit.coc_px(disparity).astype(float)
        return measure_motion([places[:, :2] for places in known], coc_px, self._most_moments)


class SelectSamples(Node):
    """The motion, where the object must be rendered at several moments."""

    name, writes = "select-samples", "moments"
    effect = MOTION_BLUR

    def __init__(self, context: NodeContext) -> None:
        self.description = "where its parts move differently"

    def __call__(self, motion: Motion) -> Motion | None:
        return motion if len(motion.ways) > 1 else None


class RenderMotion(Node):
    """The mean of the object at several moments, each through the lens."""

    name, writes = "render-motion", "blurred"
    effect = MOTION_BLUR

    def __init__(self, context: NodeContext) -> None:
        self._objects, self._shutter = context.objects, context.shutter
        self._reblur = make_reblur(context)
        self.description = "the mean of several moments, through the lens"

    def __call__(
        self, bounds: ScreenBounds, moments: Motion, layer: ObjectLayer, frame_box: Box,
        fit: LensFit | None,
    ) -> BlurredLayer:  # fmt: skip
        times = self._shutter.middles(bounds.time_s, len(moments.ways))

        def rendered(numbers: range) -> Iterator[ObjectLayer | None]:
            for number in numbers:
                if number == len(times) // 2:
                    yield layer
                else:
                    yield self._rendered(times[number], bounds, fit)

        layers = [
            self._blurred(averaged(rendered(numbers)), frame_box, fit) for numbers in moments.parts
        ]
        mean = mean_of_blurred(layers, [len(numbers) for numbers in moments.parts])
        return smeared(mean, moments.ways.mean(axis=0), frame_box)

    def _rendered(
        self, time_s: float, bounds: ScreenBounds, fit: LensFit | None
    ) -> ObjectLayer | None:
        there = self._objects.locate(0, time_s)
        if there is None:
            return None
        return self._objects.render(replace(there, plate_light=bounds.plate_light), fit)

    def _blurred(
        self, mean: ObjectLayer | None, frame_box: Box, fit: LensFit | None
    ) -> BlurredLayer:
        if mean is None:
            return BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
        if fit is not None:
            defocused = object_coc(mean, fit)
            if defocused.largest_coc_px >= NEGLIGIBLE_COC_PX:
                return self._reblur(defocused, frame_box)
        return crop_to_frame(mean, frame_box)

    def warm_up(self) -> None:
        """Compile the scatter."""
        warm_up.scatter_kernels()


class MotionBlur(Node):
    """The blurred layer, averaged along its motion; where it was rendered so, it is done."""

    name, writes = "motion-blur", "blurred"
    effect, lane, skip_if = MOTION_BLUR, "composite", "moments"

    def __init__(self, context: NodeContext) -> None:
        self.description = "along its way"

    def __call__(self, blurred: BlurredLayer, motion: Motion, frame_box: Box) -> BlurredLayer:
        return smeared(blurred, motion.ways[0], frame_box)
