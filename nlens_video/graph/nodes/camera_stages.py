"""What the plate's camera does beside its focus, as a pipeline file names it."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    Picture,
)
from nlens_video.graph.nodes.context import Made, Tools, Unavailable

if TYPE_CHECKING:
    from nlens_video.graph.nodes.stream_frame import StreamFrame


def model_of(tools: Tools, effect: str) -> object:
    """What an effect is simulated with.

    Raises:
        Unavailable: the plate did not show it.
    """
    found = tools.measured.get(effect)
    if found is None:
        raise Unavailable("the plate was not looked at")
    if found.model is None:
        raise Unavailable(found.evidence)
    return found.model


def make_soften(tools: Tools) -> Made:
    """The plate's least softness on the object."""
    from nlens_video.effects.camera.softness_apply import Floor, missing_sigma, softened

    floor = cast("Floor", model_of(tools, "softness"))

    def run(
        blurred: BlurredLayer, frame_box: Box, defocused: DefocusedLayer | None
    ) -> BlurredLayer:
        return softened(blurred, missing_sigma(floor, defocused), frame_box)

    return Made(run, f"as soft as the plate's sharpest edges, sigma {floor.sigma_px:.2f} px")


def make_grain(tools: Tools) -> Made:
    """The plate's noise on the object."""
    from nlens_video.effects.camera.grain_apply import AddGrain, GrainModel

    model = cast("GrainModel", model_of(tools, "grain"))
    stage = AddGrain(model)

    def run(picture: Picture, blurred: BlurredLayer, frame: StreamFrame) -> BlurredLayer:
        return stage(picture, blurred, frame.index)

    return Made(run, f"noise by level, {model.persistence:.0%} of it lasting, numba")
