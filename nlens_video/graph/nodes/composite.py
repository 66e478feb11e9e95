"""The last node: alpha compositing of the object over the plate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.graph.base.node import Node
from nlens_video.graph.nodes import warm_up
from nlens_video.stages.composite import composite

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, Picture
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.stages.composite import Foreground


class Composite(Node):
    """Porter-Duff over in scene-linear light, written back in the plate's own pixel format."""

    name, writes = "composite", "picture"
    lane = "composite"

    def __init__(self, context: NodeContext) -> None:
        self.description = "premultiplied over, scene-linear"

    def __call__(
        self, picture: Picture, blurred: BlurredLayer, foreground: Foreground | None
    ) -> Picture:
        return composite(picture, blurred, foreground)

    def warm_up(self) -> None:
        """Compile the blend."""
        warm_up.blend()
