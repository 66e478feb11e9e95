"""Nodes of lens distortion: overscan to render into, and the warp of what was rendered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

from nlens_video.core.box import Box
from nlens_video.core.errors import UsageError
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.distortion_apply import (
    DistortionMap,
    distort,
    distort_defocused,
    distort_shadow,
)
from nlens_video.graph.base.node import Node
from nlens_video.graph.nodes.camera import measured_model

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, DefocusedLayer, Picture
    from nlens_video.effects.measurement import Measurement
    from nlens_video.effects.shadow.apply import Shadow
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.object_source import ScreenBounds, View
    from nlens_video.scene.scene import Scene

_EFFECT = "distortion"


def _model(context: NodeContext) -> Distortion:
    return cast("Distortion", measured_model(context, _EFFECT))


class AddOverscan(Node):
    """Overscan: a frame box that holds all that the distorted frame shows."""

    name, writes = "add-overscan", "frame_box"
    effect = _EFFECT

    def __init__(self, context: NodeContext) -> None:
        self._distortion = _model(context)
        self.description = "as far beyond the border as the distortion shows"

    def __call__(self, frame_box: Box, bounds: ScreenBounds) -> Box:
        return frame_box.expanded(DistortionMap.of(self._distortion, bounds.camera).margin)


class Distort(Node):
    """Distortion of the object's layer."""

    name, writes = "distort", "blurred"
    effect, lane = _EFFECT, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._distortion = _model(context)
        self.description = _describe(self._distortion)

    def __call__(self, blurred: BlurredLayer, bounds: ScreenBounds) -> BlurredLayer:
        return distort(blurred, DistortionMap.of(self._distortion, bounds.camera))


class DistortShadow(Node):
    """Distortion of the shadow."""

    name, writes = "distort-shadow", "shadow"
    effect, lane = _EFFECT, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._distortion = _model(context)
        self.description = _describe(self._distortion)

    def __call__(self, shadow: Shadow, bounds: ScreenBounds) -> Shadow:
        return distort_shadow(shadow, DistortionMap.of(self._distortion, bounds.camera))


class DistortReflection(Node):
    """Distortion of the mirror image."""

    name, writes = "distort-reflection", "reflection"
    effect, lane = _EFFECT, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._distortion = _model(context)
        self.description = _describe(self._distortion)

    def __call__(self, reflection: DefocusedLayer, bounds: ScreenBounds) -> DefocusedLayer:
        return distort_defocused(reflection, DistortionMap.of(self._distortion, bounds.camera))


class RemoveOverscan(Node):
    """The frame box without overscan."""

    name, writes = "remove-overscan", "frame_box"
    effect, lane = _EFFECT, "composite"

    def __init__(self, context: NodeContext) -> None:
        _model(context)
        self.description = "the plate's own frame"

    def __call__(self, frame_box: Box, picture: Picture) -> Box:
        return Box(0, 0, picture.width, picture.height).intersection(frame_box)


def overscan_px(scene: Scene, view: View, measured: Mapping[str, Measurement]) -> int:
    """Overscan that a distortion calls for, with the camera at time 0 [px].

    Raises:
        UsageError: a given distortion leaves corners of the frame empty.
    """
    found = measured.get("distortion")
    if found is None or not isinstance(found.model, Distortion):
        return 0
    camera = view.placed or scene.camera(
        0.0, view.width, view.height, name=view.camera, pixel_aspect=view.pixel_aspect
    )
    warp = DistortionMap.of(found.model, camera)
    if warp.folds:
        raise UsageError(
            f"--distortion {found.model.k1:g},{found.model.k2:g}: the frame's corners stay empty "
            "with that; expected coefficients that count in focal lengths, as in OpenCV"
        )
    return warp.margin


def _describe(distortion: Distortion) -> str:
    unit = "focal lengths" if distortion.focal_normalized else "half diagonals"
    return f"k1 {distortion.k1:.3g}, k2 {distortion.k2:.3g}, radius in {unit}"
