"""Nodes of the object's planar reflection in the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import DefocusedLayer
from nlens_video.effects.motion_blur import mean_layer, sampled_count
from nlens_video.effects.planner import REFLECTION
from nlens_video.effects.reflection import RenderReflection
from nlens_video.graph.base.node import LARGEST_MOMENTS, Node, Unavailable
from nlens_video.graph.nodes.reblur import make_reblur
from nlens_video.stages.composite import composite_behind
from nlens_video.stages.l_reblur import object_coc

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, Box, ObjectLayer, Picture
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.motion_blur import Motion
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.stages.composite import Foreground


class Reflect(Node):
    """The object rendered by a camera mirrored at the ground plane, with motion blur."""

    name, writes = "reflect", "reflection"
    effect = REFLECTION
    ranges = (("most_moments", 1, LARGEST_MOMENTS),)

    def __init__(self, context: NodeContext, *, most_moments: int = 9) -> None:
        if context.renderer is None:
            raise Unavailable("pre-rendered layers hold no view from below the ground")
        self._context, self._most_moments = context, most_moments
        self._render = RenderReflection(renderer=context.renderer, reflectance=context.reflectance)
        self.description = (
            f"mirrored camera, reflectance {context.reflectance:g} at normal incidence, temporal "
            "samples where it moves by a pixel over the shutter interval"
        )

    def __call__(
        self, bounds: ScreenBounds, fit: LensFit | None, motion: Motion | None
    ) -> DefocusedLayer | None:
        context = self._context
        # the virtual image lies farther than the object; its margin holds up to infinity
        ends = np.array([1.0 / bounds.nearest, 0.0], np.float32)
        reach = 0.0 if fit is None else 0.5 * float(np.abs(fit.coc_px(ends)).max())
        reach *= max(1.0, context.pixel_aspect)

        def rendered(time_s: float) -> ObjectLayer | None:
            own = time_s == bounds.time_s
            camera = bounds.camera if own else context.objects.camera(time_s)
            return self._render(time_s, camera, context.ground_height, reach, bounds.plate_light)

        count = 1 if motion is None else self._moments(bounds.time_s, fit)
        times = context.shutter.middles(bounds.time_s, min(count, self._most_moments))
        layer = mean_layer(rendered(time_s) for time_s in times)
        if layer is None:
            return None
        if fit is None:
            return DefocusedLayer(layer=layer, coc_px=np.zeros(layer.depth.shape, np.float32))
        return object_coc(layer, fit)

    def _moments(self, time_s: float, fit: LensFit | None) -> int:
        """Number of temporal samples of the mirror image."""
        context = self._context
        if context.shadow_scene is None:
            return 1
        places, depths = [], []
        for moment in context.shutter.edges(time_s):
            points, _ = context.shadow_scene.pose(moment).points()
            vertices = points.astype(np.float64)
            vertices[:, 1] = 2.0 * context.ground_height - vertices[:, 1]
            camera = context.objects.camera(moment)
            seen = camera.to_camera(vertices)
            if not (seen[:, 2] < 0.0).all():
                return 1
            places.append(camera.pixels(seen))
            depths.append(-seen[:, 2])
        coc = 0.0 if fit is None else np.abs(fit.coc_px((1.0 / depths[1]).astype(np.float32)))
        return sampled_count(places, np.asarray(coc, dtype=np.float64))


class BlurReflection(Node):
    """The mirror image blurred by its own CoC."""

    name, writes = "blur-reflection", "mirrored"
    effect, lane = REFLECTION, "composite"
    description = "blurred by its own CoC"

    def __init__(self, context: NodeContext) -> None:
        self._blur = make_reblur(context)

    def __call__(self, reflection: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return self._blur(reflection, frame_box)


class CompositeReflection(Node):
    """The mirror image over the plate, under the object.

    The mirrored surroundings that it hides are assumed as bright as the plate is there.
    """

    name, writes = "composite-reflection", "picture"
    effect, lane = REFLECTION, "composite"
    description = "over the plate, under the object"

    def __call__(
        self, picture: Picture, mirrored: BlurredLayer, foreground: Foreground | None
    ) -> Picture:
        if not mirrored.box.empty:
            cover = None if foreground is None else foreground.before_ground
            composite_behind(picture, mirrored.box, mirrored.rgba, cover)
        return picture
