"""Nodes that stand in for shipped ones: other methods' blur, a CoC that is told."""

from __future__ import annotations

from collections.abc import Callable

from nlens_video.core.box import Box
from nlens_video.core.layers import BlurredLayer, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import DEFOCUS
from nlens_video.graph.base.conditions import OUT_OF_FOCUS
from nlens_video.graph.base.node import Node


class RivalReblur(Node):
    """Another method's blur in the place of ours."""

    name, writes = "reblur", "blurred"
    effect, lane, when = DEFOCUS, "composite", OUT_OF_FOCUS

    def __init__(self, rival: Callable[[DefocusedLayer, Box], BlurredLayer]) -> None:
        self._rival = rival

    def __call__(self, defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return self._rival(defocused, frame_box)


class GivenCoc(Node):
    """A CoC that is told, in the place of the fit's."""

    name, writes = "object-coc", "defocused"
    effect = DEFOCUS

    def __init__(self, coc: Callable[[ObjectLayer], DefocusedLayer]) -> None:
        self._coc = coc

    def __call__(self, layer: ObjectLayer, fit: LensFit) -> DefocusedLayer:
        return self._coc(layer)
