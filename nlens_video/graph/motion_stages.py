"""Motion blur, as a pipeline file names it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from nlens_video.frames import BlurredLayer, Box, ObjectLayer
from nlens_video.graph.objects import Placement
from nlens_video.graph.tools import Made, Tools
from nlens_video.lens import LensFit
from nlens_video.stages.l_reblur import (
    NEGLIGIBLE_COC_PX,
    ReblurLayer,
    crop_to_frame,
    object_coc,
)
from nlens_video.stages.motion_blur import (
    MOST_MOMENTS,
    Motion,
    measure_motion,
    smeared,
    through_shutter,
)


def make_motion(tools: Tools, *, most_moments: int = MOST_MOMENTS) -> Made:
    """What the object does on the screen while the shutter is open."""
    shutter = tools.shutter

    def run(placement: Placement, fit: LensFit | None) -> Motion | None:
        half_s = 0.5 * shutter.open_s
        edges = (placement.time_s - half_s, placement.time_s, placement.time_s + half_s)
        coc_px = _least_coc_px(placement, fit)
        return measure_motion(tools.objects.places, edges, coc_px, most_moments)

    return Made(run, f"vertices on the screen, shutter {shutter.angle_deg:g} degrees")


def make_moments(tools: Tools) -> Made:
    """The motion, where one picture does not show it."""

    def run(motion: Motion) -> Motion | None:
        return motion if len(motion.ways) > 1 else None

    return Made(run, "where its parts move differently")


def make_expose(tools: Tools) -> Made:
    """The object at the moments that its parts' motion takes."""
    from nlens_video.kernels.scatter import blur_reach, scatter

    shutter, objects = tools.shutter, tools.objects
    through_lens = ReblurLayer(
        scatter=partial(scatter, aperture=tools.aperture),
        reach=partial(blur_reach, aperture=tools.aperture),
        pixel_aspect=tools.pixel_aspect,
    )

    def run(
        placement: Placement, moments: Motion, layer: ObjectLayer, frame_box: Box,
        fit: LensFit | None,
    ) -> BlurredLayer:  # fmt: skip
        count = len(moments.ways)

        def drawn() -> Iterator[ObjectLayer | None]:
            for number, moment in enumerate(shutter.middles(placement.time_s, count)):
                if number == count // 2:
                    yield layer
                    continue
                there = objects.locate(0, moment)
                yield None if there is None else objects.render(there, fit)

        def blurred(part: ObjectLayer) -> BlurredLayer:
            if fit is not None:
                defocused = object_coc(part, fit)
                if defocused.largest_coc_px >= NEGLIGIBLE_COC_PX:
                    return through_lens(defocused, frame_box)
            return crop_to_frame(part, frame_box)

        return through_shutter(drawn(), moments.ways, blurred, frame_box)

    return Made(run, "several moments, each through the lens")


def make_smear(tools: Tools) -> Made:
    """The shutter's share in the picture."""

    def run(
        motion: Motion, frame_box: Box, blurred: BlurredLayer | None, exposed: BlurredLayer | None
    ) -> BlurredLayer | None:
        if exposed is not None:
            return exposed
        return None if blurred is None else smeared(blurred, motion.ways[0], frame_box)

    return Made(run, "along its way, or the mean of its moments")


def _least_coc_px(placement: Placement, fit: LensFit | None) -> float:
    """Least CoC diameter between the object's nearest and farthest point [px]."""
    if fit is None:
        return 0.0
    ends = fit.coc_px(np.array([1 / placement.nearest, 1 / placement.farthest], np.float32))
    return 0.0 if ends[0] * ends[1] <= 0.0 else float(np.abs(ends).min())
