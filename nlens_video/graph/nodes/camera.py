"""Nodes of the camera's effects beside defocus: vignetting, exposure, bloom, grain and others."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from nlens_video.core.box import Box
from nlens_video.effects.planner import EXPOSURE
from nlens_video.graph.base.node import Node, Unavailable

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, DefocusedLayer, Picture
    from nlens_video.core.optics import Aberration, Bloom, Vignetting
    from nlens_video.effects.camera.grain_apply import GrainModel
    from nlens_video.effects.camera.softness import SharpnessFloor
    from nlens_video.effects.exposure import Exposure
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.values import StreamFrame


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

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Vignetting", measured_model(context, "vignetting"))
        self.description = f"{self._model.at_corner_stops:.2g} stops at the corner"

    def __call__(self, blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        from nlens_video.effects.camera.vignetting import vignette

        return vignette(blurred, self._model, frame_box)


class MeasureExposure(Node):
    """Exposure drift: gain per channel of each frame relative to the first."""

    name, writes = "exposure", "exposure"
    effect, stateful = EXPOSURE, True

    def __init__(self, context: NodeContext) -> None:
        from nlens_video.effects.exposure import MeasureExposure as Measure

        self._measure = Measure()
        self.description = "median ratio of small pictures, per channel"

    def __call__(self, picture: Picture) -> Exposure | None:
        return self._measure(picture)


class MatchExposure(Node):
    """Exposure drift applied to the object."""

    name, writes = "match-exposure", "blurred"
    effect, lane = EXPOSURE, "composite"

    def __init__(self, context: NodeContext) -> None:
        self.description = "gains, where mid grey changes by 1 to 2 levels or more"

    def __call__(self, blurred: BlurredLayer, exposure: Exposure) -> BlurredLayer:
        from nlens_video.effects.exposure import match_exposure

        return match_exposure(blurred, exposure)


class BloomNode(Node):
    """Bloom: halos around the object's highlights."""

    name, writes = "bloom", "blurred"
    effect, lane = "bloom", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Bloom", measured_model(context, "bloom"))
        self.description = f"around what exceeds white, decay length {self._model.length_px:.0f} px"

    def __call__(self, blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        from nlens_video.effects.camera.bloom import add_bloom

        return add_bloom(blurred, self._model, frame_box)


class Soften(Node):
    """Floor softness: the object is no sharper than the plate's sharpest edges."""

    name, writes = "soften", "blurred"
    effect, lane = "softness", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._floor = cast("SharpnessFloor", measured_model(context, "softness"))
        sigma = self._floor.sigma_px
        self.description = f"no sharper than the plate's sharpest edges, sigma {sigma:.2f} px"

    def __call__(
        self, blurred: BlurredLayer, frame_box: Box, defocused: DefocusedLayer | None
    ) -> BlurredLayer:
        from nlens_video.effects.camera.softness import missing_sigma, soften

        return soften(blurred, missing_sigma(self._floor, defocused), frame_box)


class ChromaticAberration(Node):
    """Lateral chromatic aberration of the object."""

    name, writes = "chromatic-aberration", "blurred"
    effect, lane = "aberration", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Aberration", measured_model(context, "aberration"))
        self.description = f"red and blue displaced by up to {self._model.at_corner_px:.2g} px"

    def __call__(self, blurred: BlurredLayer, picture: Picture, frame_box: Box) -> BlurredLayer:
        from nlens_video.effects.camera.chromatic_aberration import displace_channels

        return displace_channels(blurred, self._model, picture, frame_box)


class Grain(Node):
    """Grain: the plate's noise, synthesised on the object."""

    name, writes = "grain", "blurred"
    effect, lane = "grain", "composite"

    def __init__(self, context: NodeContext) -> None:
        from nlens_video.effects.camera.grain_apply import AddGrain

        model = cast("GrainModel", measured_model(context, "grain"))
        self._add = AddGrain(model)
        self.description = f"noise by level, temporal correlation {model.persistence:.0%}, numba"

    def __call__(self, picture: Picture, blurred: BlurredLayer, frame: StreamFrame) -> BlurredLayer:
        return self._add(picture, blurred, frame.index)
