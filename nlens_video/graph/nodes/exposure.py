"""Nodes of a camera whose exposure drifts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.effects.exposure import MeasureExposure as Measure
from nlens_video.effects.exposure import match_exposure
from nlens_video.effects.planner import EXPOSURE
from nlens_video.graph.base.node import Node

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, Picture
    from nlens_video.effects.exposure import Exposure
    from nlens_video.graph.base.context import NodeContext


class MeasureExposure(Node):
    """Exposure drift: gain per channel of each frame relative to the first."""

    name, writes = "exposure", "exposure"
    effect, stateful = EXPOSURE, True

    def __init__(self, context: NodeContext) -> None:
        told = context.first_lit_frame()
        self._measure = Measure(None if told is None else told.picture)
        self.description = "median ratio of small pictures, per channel"

    def __call__(self, picture: Picture) -> Exposure | None:
        return self._measure(picture)


class MatchExposure(Node):
    """Exposure drift applied to the object."""

    name, writes = "match-exposure", "blurred"
    effect, lane = EXPOSURE, "composite"
    description = "gains, where mid grey changes by 1 to 2 levels or more"

    def __call__(self, blurred: BlurredLayer, exposure: Exposure) -> BlurredLayer:
        return match_exposure(blurred, exposure)
