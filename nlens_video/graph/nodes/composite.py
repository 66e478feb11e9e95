"""Nodes of the composite: foreground occlusion, and the object over the plate."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.cameras.placement import contact_point
from nlens_video.core.box import Box
from nlens_video.core.layers import DepthMap, Matte
from nlens_video.effects.foreground.received_shadow import Sunlight, receive_shadow
from nlens_video.effects.occlusion import (
    CoverageFromCoc,
    CoverageFromDepth,
    foreground_matte,
    moving_mattes,
    object_disparity,
)
from nlens_video.effects.occlusion_cues import MovingThings
from nlens_video.effects.planner import OCCLUSION
from nlens_video.effects.shadow.things import before_shadow
from nlens_video.graph.base.node import Node, Unavailable
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.stages.composite import Foreground, composite

if TYPE_CHECKING:
    from nlens_video.core.layers import (
        BlurredLayer,
        CocMap,
        DefocusedLayer,
        Float32,
        ObjectLayer,
        Picture,
    )
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.occlusion_cues import OcclusionCue
    from nlens_video.effects.shadow.apply import Shadow
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.video.info import SourceFrame


class Composite(Node):
    """Porter-Duff over in scene-linear light, written back in the plate's own pixel format."""

    name, writes = "composite", "picture"
    lane = "composite"
    description = "premultiplied over, scene-linear"

    def __call__(
        self, picture: Picture, blurred: BlurredLayer, foreground: Foreground | None
    ) -> Picture:
        return composite(picture, blurred, foreground)


_NO_SOURCE = "no matte, depth or CoC of the foreground is given"
_SOFTENED_PX = 16  # how far later nodes may spread the object [px]
_SPREAD_PX = 16  # beyond half a CoC, for discs on coarser pixels [px]


class OcclusionCueNode(Node):
    """Matte, depth map or CoC map from which occlusion is derived."""

    name, writes = "occlusion-cue", "occlusion_cue"
    effect = OCCLUSION

    def __init__(self, context: NodeContext) -> None:
        if context.occlusion is None:
            raise Unavailable(_NO_SOURCE)
        self._source = context.occlusion
        self.description = context.occlusion.description

    def __call__(
        self,
        frame: SourceFrame,
        picture: Picture,
        bounds: ScreenBounds,
        plate_coc: CocMap | None,
    ) -> OcclusionCue:
        return self._source.read(frame, picture, plate_coc)


class ForegroundNode(Node):
    """Foreground mattes before the object, and before its shadow and reflection on the ground."""

    name, writes = "foreground", "foreground"
    effect, lane = OCCLUSION, "composite"

    def __init__(self, context: NodeContext) -> None:
        if context.occlusion is None:
            raise Unavailable(_NO_SOURCE)
        self._context = context
        self._by_depth = CoverageFromDepth(
            scatter=partial(scatter, aperture=context.aperture), pixel_aspect=context.pixel_aspect
        )
        self._by_coc = CoverageFromCoc()
        self.description = (
            "object behind it, its light separated from the background's in soft edges"
        )

    def __call__(
        self, occlusion_cue: OcclusionCue, picture: Picture, bounds: ScreenBounds,
        frame_box: Box, fit: LensFit | None, layer: ObjectLayer | None,
        blurred: BlurredLayer | None, shadow: Shadow | None, reflection: DefocusedLayer | None,
    ) -> Foreground | None:  # fmt: skip
        object_region = Box(0, 0, 0, 0)
        if blurred is not None and not blurred.box.empty:
            object_region = blurred.box.expanded(_SOFTENED_PX).intersection(frame_box)
        ground_region = _on_ground(shadow, reflection, frame_box)
        if isinstance(occlusion_cue, Matte):
            region = object_region.union(ground_region)
            cover = foreground_matte(picture, region, occlusion_cue.coverage)
            if cover is None:
                return None
            return Foreground(before_object=cover, before_ground=cover, before_shadow=cover)
        if isinstance(occlusion_cue, MovingThings):
            region = object_region.union(ground_region)
            moving = occlusion_cue.matte(picture, region, fit)
            return None if moving is None else moving_mattes(picture, moving)
        over_object = over_ground = over_shadow = None
        if layer is not None and not object_region.empty:
            surface = object_disparity(layer, frame_box)
            share = self._coverage(occlusion_cue, surface, object_region, fit, picture)
            over_object = foreground_matte(picture, object_region, share)
        if not ground_region.empty:
            height = self._context.ground_height
            surface = bounds.camera.plane_disparity(height).astype(np.float32)
            on_things = shadow is not None and shadow.on_things
            if reflection is not None or not on_things:
                share = self._coverage(occlusion_cue, surface, ground_region, fit, picture)
                over_ground = over_shadow = foreground_matte(picture, ground_region, share)
            if isinstance(occlusion_cue, DepthMap) and shadow is not None and on_things:
                before = before_shadow(occlusion_cue, surface, bounds.nearest, shadow)
                share = self._by_depth(before, surface, ground_region, fit)
                over_shadow = foreground_matte(picture, ground_region, share)
        return Foreground(
            before_object=over_object, before_ground=over_ground, before_shadow=over_shadow
        )

    def _coverage(
        self, cue: DepthMap | CocMap, disparity: Float32, region: Box, fit: LensFit | None,
        picture: Picture,
    ) -> Float32:  # fmt: skip
        if isinstance(cue, DepthMap):
            return self._by_depth(cue, disparity, region, fit)
        if fit is None:
            return np.zeros(disparity.shape, np.float32)
        return self._by_coc(cue, disparity, region, fit, picture.srgb())


class ReceiveShadow(Node):
    """The shadow that what moves in the plate casts on the object, under a known sun."""

    name, writes = "receive-shadow", "blurred"
    effect, lane = OCCLUSION, "composite"
    description = "shadow of what moves on the object, by the plate's ground"

    def __init__(self, context: NodeContext) -> None:
        if context.occlusion is None:
            raise Unavailable(_NO_SOURCE)
        if context.shadow_scene is None:
            raise Unavailable("the object's light is not known")
        self._scene, self._context = context.shadow_scene, context

    def __call__(
        self, blurred: BlurredLayer, occlusion_cue: OcclusionCue, picture: Picture,
        bounds: ScreenBounds, defocused: DefocusedLayer,
    ) -> BlurredLayer:  # fmt: skip
        if not isinstance(occlusion_cue, MovingThings) or not len(occlusion_cue.feet):
            return blurred
        if blurred.box.empty:
            return blurred
        pose, camera = self._scene.pose(bounds.time_s), bounds.camera
        light = self._scene.light.on_object(pose.lights, bounds.plate_light)
        sun = self._scene.light.known_sun(light, camera, pose.lights)
        if sun is None:
            return blurred
        contact = contact_point(pose.vertices(), self._context.ground_height)
        ground = self._scene.light.on_ground(pose.lights, bounds.plate_light)
        sunlight = Sunlight.known(sun, light, ground, contact)
        if sunlight is None:
            return blurred
        return receive_shadow(blurred, defocused, picture, occlusion_cue, camera, contact, sunlight)


def _on_ground(shadow: Shadow | None, reflection: DefocusedLayer | None, frame: Box) -> Box:
    """Bounds of shadow and reflection with their blur, inside the frame."""
    found = Box(0, 0, 0, 0)
    for box, coc in (
        (shadow.box, shadow.coc_px) if shadow is not None else (found, None),
        (reflection.layer.box, reflection.coc_px) if reflection is not None else (found, None),
    ):
        if coc is not None:
            reach = math.ceil(0.5 * float(np.abs(coc).max(initial=0.0))) + _SPREAD_PX
            found = found.union(box.expanded(reach).intersection(frame))
    return found
