"""What a lens does beside focusing, as a pipeline file names it."""

from __future__ import annotations

from typing import cast

from nlens_video.frames import BlurredLayer, Box, Picture
from nlens_video.graph.camera_stages import model_of
from nlens_video.graph.tools import Made, Tools
from nlens_video.optics import Aberration, Vignetting


def make_fringe(tools: Tools) -> Made:
    """Lateral chromatic aberration of the object."""
    from nlens_video.stages.aberration import fringed

    aberration = cast("Aberration", model_of(tools, "aberration"))

    def run(blurred: BlurredLayer, picture: Picture, frame_box: Box) -> BlurredLayer:
        return fringed(blurred, aberration, picture, frame_box)

    return Made(run, f"red and blue displaced by up to {aberration.at_corner_px:.2g} px")


def make_vignette(tools: Tools) -> Made:
    """Loss of the object's light towards the corners."""
    from nlens_video.stages.vignetting import vignetted

    vignetting = cast("Vignetting", model_of(tools, "vignetting"))

    def run(blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return vignetted(blurred, vignetting, frame_box)

    return Made(run, f"{vignetting.at_corner_stops:.2g} stops at the corner")


def make_exposure(tools: Tools) -> Made:
    """The plate's exposure, frame by frame."""
    from nlens_video.stages.exposure import MeasureExposure

    return Made(MeasureExposure(), "median ratio of small pictures, per channel")


def make_follow(tools: Tools) -> Made:
    """The object in the exposure of its frame."""
    from nlens_video.stages.exposure import follow

    return Made(follow, "gains, where mid grey changes by 1 to 2 levels or more")
