"""Nodes of the camera's effects beside defocus and exposure, such as lens distortion and grain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, cast

from nlens_video.core.box import Box
from nlens_video.core.errors import UsageError
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.bloom import add_bloom
from nlens_video.effects.camera.chromatic_aberration import displace_channels
from nlens_video.effects.camera.distortion_apply import (
    DistortionMap,
    distort,
    distort_defocused,
    distort_shadow,
)
from nlens_video.effects.camera.grain import AddGrain
from nlens_video.effects.camera.grain_restore import RestoreGrain
from nlens_video.effects.camera.softness import missing_sigma, soften
from nlens_video.effects.camera.vignetting import vignette
from nlens_video.graph.base.node import Node, Unavailable

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, DefocusedLayer, Picture
    from nlens_video.core.optics import Aberration, Bloom, Vignetting
    from nlens_video.effects.camera.grain import GrainModel
    from nlens_video.effects.camera.softness import SharpnessFloor
    from nlens_video.effects.measurement import Measurement
    from nlens_video.effects.shadow.apply import Shadow
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds, View
    from nlens_video.scene.scene import Scene
    from nlens_video.video.info import SourceFrame

_DISTORTION = "distortion"


def measured_model(context: NodeContext, effect: str) -> object:
    """The model of an effect, as it was measured on the plate or given by an option.

    Raises:
        Unavailable: the effect was not measured, or does not show on the plate.
    """
    found = context.measured.get(effect)
    if found is None:
        raise Unavailable("not measured on this plate")
    if found.model is None:
        raise Unavailable(found.evidence)
    return found.model


class Vignette(Node):
    """Vignetting of the object: radial falloff of its light."""

    name, writes = "vignette", "blurred"
    effect, lane = "vignetting", "composite"
    same_with = ("blurred", "frame_box")

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Vignetting", measured_model(context, "vignetting"))
        self.description = f"{self._model.at_corner_stops:.2g} stops at the corner"

    def __call__(self, blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return vignette(blurred, self._model, frame_box)


class BloomNode(Node):
    """Bloom: halos around the object's highlights."""

    name, writes = "bloom", "blurred"
    effect, lane = "bloom", "composite"
    same_with = ("blurred", "frame_box")

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Bloom", measured_model(context, "bloom"))
        self.description = f"around what exceeds white, decay length {self._model.length_px:.0f} px"

    def __call__(self, blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return add_bloom(blurred, self._model, frame_box)


class Soften(Node):
    """Floor softness: the object is no sharper than the plate's sharpest edges."""

    name, writes = "soften", "blurred"
    effect, lane = "softness", "composite"
    same_with = ("blurred", "frame_box", "defocused")

    def __init__(self, context: NodeContext) -> None:
        self._floor = cast("SharpnessFloor", measured_model(context, "softness"))
        sigma = self._floor.sigma_px
        self.description = f"no sharper than the plate's sharpest edges, sigma {sigma:.2f} px"

    def __call__(
        self, blurred: BlurredLayer, frame_box: Box, defocused: DefocusedLayer | None
    ) -> BlurredLayer:
        return soften(blurred, missing_sigma(self._floor, defocused), frame_box)


class ChromaticAberration(Node):
    """Lateral chromatic aberration of the object."""

    name, writes = "chromatic-aberration", "blurred"
    effect, lane = "aberration", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Aberration", measured_model(context, "aberration"))
        self.description = f"red and blue displaced by up to {self._model.at_corner_px:.2g} px"

    def __call__(self, blurred: BlurredLayer, picture: Picture, frame_box: Box) -> BlurredLayer:
        return displace_channels(blurred, self._model, picture, frame_box)


class Grain(Node):
    """Grain: the plate's noise, synthesised on the object."""

    name, writes = "grain", "blurred"
    effect, lane = "grain", "composite"
    draw: ClassVar[int] = 0

    def __init__(self, context: NodeContext) -> None:
        model = cast("GrainModel", measured_model(context, "grain"))
        self._add = AddGrain(model, self.draw)
        self.description = f"noise by level, temporal correlation {model.persistence:.0%}, C++"

    def __call__(self, picture: Picture, blurred: BlurredLayer, frame: SourceFrame) -> BlurredLayer:
        return self._add(picture, blurred, frame.index)


class GrainShadow(Node):
    """Grain of the shadow: what the plate's noise lacks once it is darkened."""

    name, writes = "grain-shadow", "darkening"
    effect, lane = "grain", "composite"
    description = "missing noise by level, where a twentieth of the light is lost or more"

    def __init__(self, context: NodeContext) -> None:
        self._add = RestoreGrain(cast("GrainModel", measured_model(context, "grain")), draw=2)

    def __call__(
        self, picture: Picture, darkening: BlurredLayer, frame: SourceFrame
    ) -> BlurredLayer:
        return self._add(picture, darkening, frame.index)


class _Distorts:
    """What the nodes of lens distortion share: the model, and its map for a frame's camera."""

    description = ""

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Distortion", measured_model(context, _DISTORTION))
        if not self.description:
            unit = "focal lengths" if self._model.focal_normalized else "half diagonals"
            self.description = f"k1 {self._model.k1:.3g}, k2 {self._model.k2:.3g}, radius in {unit}"

    def _map(self, bounds: ScreenBounds) -> DistortionMap:
        return DistortionMap.of(self._model, bounds.camera)


class AddOverscan(_Distorts, Node):
    """Overscan: a frame box that holds all that the distorted frame shows."""

    name, writes = "add-overscan", "frame_box"
    effect = _DISTORTION
    description = "as far beyond the border as the distortion shows"

    def __call__(self, frame_box: Box, bounds: ScreenBounds) -> Box:
        return frame_box.expanded(self._map(bounds).margin)


class Distort(_Distorts, Node):
    """Distortion of the object's layer."""

    name, writes = "distort", "blurred"
    effect, lane = _DISTORTION, "composite"

    def __call__(self, blurred: BlurredLayer, bounds: ScreenBounds) -> BlurredLayer:
        return distort(blurred, self._map(bounds))


class DistortShadow(_Distorts, Node):
    """Distortion of the shadow."""

    name, writes = "distort-shadow", "shadow"
    effect, lane = _DISTORTION, "composite"

    def __call__(self, shadow: Shadow, bounds: ScreenBounds) -> Shadow:
        return distort_shadow(shadow, self._map(bounds))


class DistortReflection(_Distorts, Node):
    """Distortion of the mirror image."""

    name, writes = "distort-reflection", "reflection"
    effect, lane = _DISTORTION, "composite"

    def __call__(self, reflection: DefocusedLayer, bounds: ScreenBounds) -> DefocusedLayer:
        return distort_defocused(reflection, self._map(bounds))


class RemoveOverscan(_Distorts, Node):
    """The frame box without overscan."""

    name, writes = "remove-overscan", "frame_box"
    effect, lane = _DISTORTION, "composite"
    description = "the plate's own frame"

    def __call__(self, frame_box: Box, picture: Picture) -> Box:
        return Box(0, 0, picture.width, picture.height).intersection(frame_box)


def overscan_px(scene: Scene, view: View, measured: Mapping[str, Measurement]) -> int:
    """Overscan that a distortion calls for, with the camera at time 0 and where it zooms to [px].

    Raises:
        UsageError: a given distortion leaves corners of the frame empty.
    """
    found = measured.get(_DISTORTION)
    if found is None or not isinstance(found.model, Distortion):
        return 0
    times = {0.0, *view.zoom_ends(scene)} if found.model.focal_normalized else {0.0}
    warps = [DistortionMap.of(found.model, view.camera_at(scene, time_s)) for time_s in times]
    given = found.model.focal_normalized  # a measured one may leave the corners out
    if given and any(warp.folds for warp in warps):
        raise UsageError(
            f"--distortion {found.model.k1:g},{found.model.k2:g}: the frame's corners stay empty "
            "with that; expected coefficients that count in focal lengths, as in OpenCV"
        )
    return max(warp.margin for warp in warps)
