"""Nodes that render the object: lighting, colour and depth, CoC, hidden surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.core.box import Box
from nlens_video.effects.planner import DEFOCUS
from nlens_video.graph.base.node import DEPTH_RANGE, Node, Unavailable
from nlens_video.scene.illumination import Illumination
from nlens_video.stages.l_reblur import object_coc

if TYPE_CHECKING:
    from nlens_video.core.layers import DefocusedLayer, ObjectLayer, Picture
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds


class EstimateLight(Node):
    """Lighting of the object from the first frame, where no file gives any."""

    name, writes = "estimate-light", "plate_light"
    stateful = True

    def __init__(self, context: NodeContext) -> None:
        scene = context.shadow_scene
        if scene is None:
            raise Unavailable("no scene to light")
        if scene.pre_rendered:
            raise Unavailable("pre-rendered layers are lit already")
        if scene.light.known:
            raise Unavailable("the GLB or an environment map lights the object")
        self._light: Illumination | None = None
        self.description = "from the mean colour of the first frame and of its upper part"

    def __call__(self, picture: Picture) -> Illumination:
        if self._light is None:
            whole = Box(0, 0, picture.width, picture.height)
            self._light = Illumination.of_plate(picture.linear(whole))
        return self._light


class Render(Node):
    """Colour, coverage and depth of the object, beyond the frame as far as its blur reaches."""

    name, writes = "render", "layer"

    def __init__(self, context: NodeContext) -> None:
        self._objects = context.objects
        self.description = context.objects.description

    def __call__(self, bounds: ScreenBounds, fit: LensFit | None) -> ObjectLayer | None:
        return self._objects.render(bounds, fit)

    def warm_up(self) -> None:
        """Compile the renderer's kernels, if it has any."""
        self._objects.warm_up()


class ObjectCoc(Node):
    """CoC of each pixel of the object from its depth (paper, eq. 2)."""

    name, writes = "object-coc", "defocused"
    effect = DEFOCUS

    def __init__(self, context: NodeContext) -> None:
        self.description = "slope * disparity + intercept"

    def __call__(self, layer: ObjectLayer, fit: LensFit) -> DefocusedLayer:
        return object_coc(layer, fit)


class DepthPeel(Node):
    """Second depth layer of the object (depth peeling, Everitt 2001), where the lens sees it."""

    name, writes = "depth-peel", "defocused"
    effect, when, skip_if = DEFOCUS, DEPTH_RANGE, "moments"

    def __init__(self, context: NodeContext) -> None:
        if context.renderer is None:
            raise Unavailable(
                "pre-rendered layers hold the nearest surfaces only: what they hide of the object "
                "is guessed from what is seen of it"
            )
        self._renderer = context.renderer
        self.description = f"depth-peeled second layer, {context.objects.description}"

    def __call__(
        self, defocused: DefocusedLayer, fit: LensFit, bounds: ScreenBounds
    ) -> DefocusedLayer:
        from nlens_video.stages.l_reblur import depth_peel

        return depth_peel(defocused, fit, bounds.farthest, self._renderer)
