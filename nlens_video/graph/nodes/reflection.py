"""The nodes of the object's mirror image in the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import DefocusedLayer
from nlens_video.effects.motion_blur import averaged, sampled_count
from nlens_video.effects.planner import REFLECTION
from nlens_video.effects.reflection import LayReflection, MirrorObject
from nlens_video.graph.base.node import Node, Unavailable
from nlens_video.graph.nodes.reblur import make_reblur
from nlens_video.stages.l_reblur import object_coc

if TYPE_CHECKING:
    from nlens_video.core.layers import Box, ObjectLayer, Picture
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.motion_blur import Motion
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.object_source import ScreenBounds
    from nlens_video.stages.composite import Foreground


class Reflect(Node):
    """The object's mirror image, blurred by its motion where that shows."""

    name, writes = "reflect", "reflection"
    effect = REFLECTION

    def __init__(self, context: NodeContext, *, most_moments: int = 9) -> None:
        if context.views is None:
            raise Unavailable("pre-rendered layers do not show the object from below")
        self._context, self._most_moments = context, most_moments
        self._render = MirrorObject(renderer=context.views, reflectance=context.reflectance)
        self.description = (
            f"the mirrored camera's picture, {context.reflectance:g} from straight above, at "
            "several moments where it moves by a pixel while the shutter is open"
        )

    def __call__(
        self, bounds: ScreenBounds, fit: LensFit | None, motion: Motion | None
    ) -> DefocusedLayer | None:
        context = self._context
        # The virtual image lies farther off than the object: up to infinity, to be on the safe side
        ends = np.array([1.0 / bounds.nearest, 0.0], np.float32)
        reach = 0.0 if fit is None else 0.5 * float(np.abs(fit.coc_px(ends)).max())
        reach *= max(1.0, context.pixel_aspect)

        def rendered(time_s: float) -> ObjectLayer | None:
            own = time_s == bounds.time_s
            camera = bounds.camera if own else context.objects.camera(time_s)
            return self._render(time_s, camera, context.ground_height, reach, bounds.plate_light)

        count = 1 if motion is None else self._moments(bounds.time_s, fit)
        times = context.shutter.middles(bounds.time_s, min(count, self._most_moments))
        layer = averaged(rendered(time_s) for time_s in times)
        if layer is None:
            return None
        if fit is None:
            return DefocusedLayer(layer=layer, coc_px=np.zeros(layer.depth.shape, np.float32))
        return object_coc(layer, fit)

    def _moments(self, time_s: float, fit: LensFit | None) -> int:
        """How many moments the mirror image's motion takes."""
        context = self._context
        if context.shadow_scene is None:
            return 1
        places, depths = [], []
        for moment in context.shutter.edges(time_s):
            vertices = context.shadow_scene.pose(moment).vertices().astype(np.float64)
            vertices[:, 1] = 2.0 * context.ground_height - vertices[:, 1]
            camera = context.objects.camera(moment)
            seen = camera.to_camera(vertices)
            if not (seen[:, 2] < 0.0).all():
                return 1
            places.append(camera.pixels(seen))
            depths.append(-seen[:, 2])
        coc = 0.0 if fit is None else np.abs(fit.coc_px((1.0 / depths[1]).astype(np.float32)))
        return sampled_count(places, np.asarray(coc, dtype=np.float64))


class CompositeReflection(Node):
    """The mirror image over the ground and under the object, blurred by its own depth."""

    name, writes = "composite-reflection", "picture"
    effect, lane = REFLECTION, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._lay = LayReflection(make_reblur(context))
        self.description = "over the ground and under the object, blurred by its own depth"

    def __call__(
        self, picture: Picture, reflection: DefocusedLayer, frame_box: Box,
        foreground: Foreground | None,
    ) -> Picture:  # fmt: skip
        cover = None if foreground is None else foreground.before_ground
        return self._lay(picture, reflection, frame_box, cover)
