"""Motion blur, as a pipeline file names it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.motion_blur import (
    MOST_MOMENTS,
    NEGLIGIBLE_SPAN_PX,
    Motion,
    averaged,
    mean_of_blurred,
    measure_motion,
    smeared,
)
from nlens_video.graph.nodes.context import Made, Tools
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.graph.nodes.through_lens import through_lens
from nlens_video.stages.l_reblur import (
    NEGLIGIBLE_COC_PX,
    crop_to_frame,
    object_coc,
)


def make_motion(tools: Tools, *, most_moments: int = MOST_MOMENTS) -> Made:
    """What the object does on the screen while the shutter is open."""
    shutter = tools.shutter

    def run(placement: Placement, fit: LensFit | None) -> Motion | None:
        moments = shutter.edges(placement.time_s)
        if tools.objects.travel_bound_px(moments) < NEGLIGIBLE_SPAN_PX:
            return None
        seen = [tools.objects.places(moment) for moment in moments]
        known = [places for places in seen if places is not None and len(places)]
        if len(known) < len(seen):
            return None
        disparity = np.array([1.0 / places[:, 2] for places in known], np.float32)
        coc_px = np.zeros(disparity.shape) if fit is None else fit.coc_px(disparity).astype(float)
        return measure_motion([places[:, :2] for places in known], coc_px, most_moments)

    return Made(run, f"vertices on the screen, shutter {shutter.angle_deg:g} degrees")


def make_moments(tools: Tools) -> Made:
    """The motion, where one picture does not show it."""

    def run(motion: Motion) -> Motion | None:
        return motion if len(motion.ways) > 1 else None

    return Made(run, "where its parts move differently")


def make_expose(tools: Tools) -> Made:
    """The object at the moments that its parts' motion takes."""
    shutter, objects, lens = tools.shutter, tools.objects, through_lens(tools)

    def run(
        placement: Placement, moments: Motion, layer: ObjectLayer, frame_box: Box,
        fit: LensFit | None,
    ) -> BlurredLayer:  # fmt: skip
        times = shutter.middles(placement.time_s, len(moments.ways))

        def drawn(numbers: range) -> Iterator[ObjectLayer | None]:
            for number in numbers:
                if number == len(times) // 2:
                    yield layer
                    continue
                there = objects.locate(0, times[number])
                yield None if there is None else objects.render(there, fit)

        def blurred(mean: ObjectLayer | None) -> BlurredLayer:
            if mean is None:
                return BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
            if fit is not None:
                defocused = object_coc(mean, fit)
                if defocused.largest_coc_px >= NEGLIGIBLE_COC_PX:
                    return lens(defocused, frame_box)
            return crop_to_frame(mean, frame_box)

        parts = moments.parts
        layers = [blurred(averaged(drawn(numbers))) for numbers in parts]
        mean = mean_of_blurred(layers, [len(numbers) for numbers in parts])
        return smeared(mean, moments.ways.mean(axis=0), frame_box)

    return Made(run, "the mean of several moments, through the lens")


def make_smear(tools: Tools) -> Made:
    """The shutter's share in the picture."""

    def run(
        motion: Motion, frame_box: Box, blurred: BlurredLayer | None, exposed: BlurredLayer | None
    ) -> BlurredLayer | None:
        if exposed is not None:
            return exposed
        return None if blurred is None else smeared(blurred, motion.ways[0], frame_box)

    return Made(run, "along its way, or the mean of its moments")
