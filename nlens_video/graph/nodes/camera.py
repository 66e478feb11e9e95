"""The nodes of the plate's camera beside defocus: vignetting, exposure, bloom, grain, others."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from nlens_video.core.box import Box
from nlens_video.effects.planner import EXPOSURE
from nlens_video.graph.base.node import Node, Unavailable

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, DefocusedLayer, Picture
    from nlens_video.core.lens_models import Aberration, Bloom, Vignetting
    from nlens_video.effects.camera.grain_apply import GrainModel
    from nlens_video.effects.camera.softness import Floor
    from nlens_video.effects.exposure import Exposure
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.values import StreamFrame


def model_of(context: NodeContext, effect: str) -> object:
    """What an effect is simulated with.

    Raises:
        Unavailable: the plate did not show it.
    """
    found = context.measured.get(effect)
    if found is None:
        raise Unavailable("the plate was not looked at")
    if found.model is None:
        raise Unavailable(found.evidence)
    return found.model


class Vignette(Node):
    """Loss of the object's light towards the corners."""

    name, writes = "vignette", "blurred"
    effect, lane = "vignetting", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Vignetting", model_of(context, "vignetting"))
        self.description = f"{self._model.at_corner_stops:.2g} stops at the corner"

    def __call__(self, blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        from nlens_video.effects.camera.vignetting import vignetted

        return vignetted(blurred, self._model, frame_box)


class MeasureExposure(Node):
    """The plate's exposure, frame by frame."""

    name, writes = "exposure", "exposure"
    effect, stateful = EXPOSURE, True

    def __init__(self, context: NodeContext) -> None:
        from nlens_video.effects.exposure import MeasureExposure as Measure

        self._measure = Measure()
        self.description = "median ratio of small pictures, per channel"

    def __call__(self, picture: Picture) -> Exposure | None:
        return self._measure(picture)


class MatchExposure(Node):
    """The object in the exposure of its frame."""

    name, writes = "match-exposure", "blurred"
    effect, lane = EXPOSURE, "composite"

    def __init__(self, context: NodeContext) -> None:
        self.description = "gains, where mid grey changes by 1 to 2 levels or more"

    def __call__(self, blurred: BlurredLayer, exposure: Exposure) -> BlurredLayer:
        from nlens_video.effects.exposure import follow

        return follow(blurred, exposure)


class BloomNode(Node):
    """Halos round the object's highlights."""

    name, writes = "bloom", "blurred"
    effect, lane = "bloom", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Bloom", model_of(context, "bloom"))
        self.description = f"round what exceeds white, {self._model.length_px:.0f} px to a third"

    def __call__(self, blurred: BlurredLayer, frame_box: Box) -> BlurredLayer:
        from nlens_video.effects.camera.bloom import bloomed

        return bloomed(blurred, self._model, frame_box)


class Soften(Node):
    """The plate's least softness on the object."""

    name, writes = "soften", "blurred"
    effect, lane = "softness", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._floor = cast("Floor", model_of(context, "softness"))
        sigma = self._floor.sigma_px
        self.description = f"as soft as the plate's sharpest edges, sigma {sigma:.2f} px"

    def __call__(
        self, blurred: BlurredLayer, frame_box: Box, defocused: DefocusedLayer | None
    ) -> BlurredLayer:
        from nlens_video.effects.camera.softness import missing_sigma, softened

        return softened(blurred, missing_sigma(self._floor, defocused), frame_box)


class ChromaticAberration(Node):
    """Lateral chromatic aberration of the object."""

    name, writes = "chromatic-aberration", "blurred"
    effect, lane = "aberration", "composite"

    def __init__(self, context: NodeContext) -> None:
        self._model = cast("Aberration", model_of(context, "aberration"))
        self.description = f"red and blue displaced by up to {self._model.at_corner_px:.2g} px"

    def __call__(self, blurred: BlurredLayer, picture: Picture, frame_box: Box) -> BlurredLayer:
        from nlens_video.effects.camera.chromatic_aberration import displace_channels

        return displace_channels(blurred, self._model, picture, frame_box)


class Grain(Node):
    """The plate's noise on the object."""

    name, writes = "grain", "blurred"
    effect, lane = "grain", "composite"

    def __init__(self, context: NodeContext) -> None:
        from nlens_video.effects.camera.grain_apply import AddGrain

        model = cast("GrainModel", model_of(context, "grain"))
        self._add = AddGrain(model)
        self.description = f"noise by level, {model.persistence:.0%} of it lasting, numba"

    def __call__(self, picture: Picture, blurred: BlurredLayer, frame: StreamFrame) -> BlurredLayer:
        return self._add(picture, blurred, frame.index)
