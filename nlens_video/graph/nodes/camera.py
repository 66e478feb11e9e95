"""What a lens does beside focusing, as a pipeline file names it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from nlens_video.core.errors import UsageError
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    Picture,
)
from nlens_video.core.lens_models import (
    Aberration,
    Bloom,
    Distortion,
    Vignetting,
)
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.shadow.apply import Shadow
from nlens_video.graph.nodes.camera_stages import model_of
from nlens_video.graph.nodes.context import Made, Stage, Tools
from nlens_video.graph.nodes.object_source import Placement, View
from nlens_video.scene.scene import Scene


def make_fringe(tools: Tools) -> Made:
    """Lateral chromatic aberration of the object."""
    from nlens_video.effects.camera.chromatic_aberration_apply import fringed

    aberration = cast("Aberration", model_of(tools, "aberration"))

    def run(blurred: BlurredLayer, picture: Picture, frame_box: Box) -> BlurredLayer:
        return fringed(blurred, aberration, picture, frame_box)

    return Made(run, f"red and blue displaced by up to {aberration.at_corner_px:.2g} px")


def make_vignette(tools: Tools) -> Made:
    """Loss of the object's light towards the corners."""
    from nlens_video.effects.camera.vignetting_apply import vignetted

    vignetting = cast("Vignetting", model_of(tools, "vignetting"))

    def run(blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return vignetted(blurred, vignetting, frame_box)

    return Made(run, f"{vignetting.at_corner_stops:.2g} stops at the corner")


def make_bloom(tools: Tools) -> Made:
    """Halos round the object's highlights."""
    from nlens_video.effects.camera.bloom_apply import bloomed

    bloom = cast("Bloom", model_of(tools, "bloom"))

    def run(blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return bloomed(blurred, bloom, frame_box)

    return Made(run, f"round what exceeds white, {bloom.length_px:.0f} px to a third")


def make_widen(tools: Tools) -> Made:
    """A frame wide enough for what the lens pulls in from beyond its border."""
    from nlens_video.effects.camera.distortion_apply import Bend

    distortion = cast("Distortion", model_of(tools, "distortion"))

    def run(frame_box: Box, placement: Placement) -> Box:
        return frame_box.grown(Bend.of(distortion, placement.camera).margin)

    return Made(run, "as far beyond the border as the lens sees")


def make_bend(tools: Tools) -> Made:
    """The object where the lens puts it."""
    from nlens_video.effects.camera.distortion_apply import Bend, bent

    distortion = cast("Distortion", model_of(tools, "distortion"))

    def run(blurred: BlurredLayer, placement: Placement) -> BlurredLayer:
        return bent(blurred, Bend.of(distortion, placement.camera))

    return Made(run, _words(distortion))


def make_bend_shadow(tools: Tools) -> Made:
    """The shadow where the lens puts it."""
    from nlens_video.effects.camera.distortion_apply import Bend, bent_shadow

    distortion = cast("Distortion", model_of(tools, "distortion"))

    def run(shadow: Shadow, placement: Placement) -> Shadow:
        return bent_shadow(shadow, Bend.of(distortion, placement.camera))

    return Made(run, _words(distortion))


def make_bend_reflection(tools: Tools) -> Made:
    """The mirror image where the lens puts it."""
    from nlens_video.effects.camera.distortion_apply import Bend, bent_defocused

    distortion = cast("Distortion", model_of(tools, "distortion"))

    def run(reflection: DefocusedLayer, placement: Placement) -> DefocusedLayer:
        return bent_defocused(reflection, Bend.of(distortion, placement.camera))

    return Made(run, _words(distortion))


def make_narrow(tools: Tools) -> Made:
    """The frame itself again."""
    model_of(tools, "distortion")

    def run(picture: Picture) -> Box:
        return Box(0, 0, picture.width, picture.height)

    return Made(run, "the plate's own")


def seen_beyond(scene: Scene, view: View, measured: Mapping[str, Measurement]) -> int:
    """How far beyond the frame a distorting lens sees, as the camera is at first [px].

    Raises:
        UsageError: a given distortion leaves corners of the frame empty.
    """
    found = measured.get("distortion")
    if found is None or not isinstance(found.model, Distortion):
        return 0
    from nlens_video.effects.camera.distortion_apply import Bend

    camera = view.placed or scene.camera(
        0.0, view.width, view.height, name=view.camera, pixel_aspect=view.pixel_aspect
    )
    bend = Bend.of(found.model, camera)
    if bend.folds:
        raise UsageError(
            f"--distortion {found.model.k1:g},{found.model.k2:g}: nothing is seen in the frame's "
            "corners with that; expected coefficients that count in focal lengths, as in OpenCV"
        )
    return bend.margin


def _words(distortion: Distortion) -> str:
    unit = "focal lengths" if distortion.of_focal else "half diagonals"
    return f"k1 {distortion.k1:.3g}, k2 {distortion.k2:.3g}, radius in {unit}"


def make_exposure(tools: Tools) -> Made:
    """The plate's exposure, frame by frame."""
    from nlens_video.effects.exposure import MeasureExposure

    words = "median ratio of small pictures, per channel"
    return Made(MeasureExposure(), words, remembers=True)


def make_follow(tools: Tools) -> Made:
    """The object in the exposure of its frame."""
    from nlens_video.effects.exposure import follow

    return Made(follow, "gains, where mid grey changes by 1 to 2 levels or more")


OPTICS: dict[str, Stage] = {
    "widen": Stage(make_widen, ("frame_box", "placement"), "frame_box"),
    "bend": Stage(make_bend, ("blurred", "placement"), "blurred"),
    "bend-shadow": Stage(make_bend_shadow, ("shadow", "placement"), "shadow"),
    "bend-reflection": Stage(make_bend_reflection, ("reflection", "placement"), "reflection"),
    "narrow": Stage(make_narrow, ("picture",), "frame_box"),
    "bloom": Stage(make_bloom, ("blurred", "frame_box"), "blurred"),
    "fringe": Stage(make_fringe, ("blurred", "picture", "frame_box"), "blurred"),
    "exposure": Stage(make_exposure, ("picture",), "exposure"),
    "follow": Stage(make_follow, ("blurred", "exposure"), "blurred"),
    "vignette": Stage(make_vignette, ("blurred", "frame_box"), "blurred"),
}
"""The stages of this module, by the names that pipeline files use."""
