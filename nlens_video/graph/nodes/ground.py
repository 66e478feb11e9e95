"""Nodes of what the object does to the ground: its shadow and its planar reflection."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.box import Box
from nlens_video.core.layers import DefocusedLayer
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.distortion_apply import DistortionMap, undistorted_depth
from nlens_video.effects.motion_blur import mean_layer, sampled_count
from nlens_video.effects.planner import REFLECTION, SHADOW
from nlens_video.effects.reflection import OverlayReflection, RenderReflection
from nlens_video.effects.shadow.apply import ApplyShadow, ground_blur
from nlens_video.effects.shadow.cast import CastShadow, Moment, shadow_places
from nlens_video.effects.shadow.cast_on_things import CastOnThings
from nlens_video.effects.shadow.casters import CasterCache, Casters
from nlens_video.graph.base.node import Node, Unavailable
from nlens_video.graph.nodes.reblur import make_reblur
from nlens_video.stages.l_reblur import object_coc

if TYPE_CHECKING:
    from nlens_video.core.layers import Box, DepthMap, Float64, ObjectLayer, Picture
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.motion_blur import Motion
    from nlens_video.effects.shadow.apply import BlurredShadow, Shadow
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.scene.illumination import Illumination
    from nlens_video.stages.composite import Foreground
    from nlens_video.video.info import SourceFrame


class PlateDepth(Node):
    """Depth of what the plate shows, on which the shadow falls beside the ground."""

    name, writes = "plate-depth", "plate_depth"
    effect = SHADOW

    def __init__(self, context: NodeContext) -> None:
        source = context.occlusion
        if source is None or source.depth is None:
            raise Unavailable("no depth of the plate is given")
        self._depth = source.depth
        distortion = context.measured.get("distortion")
        model = None if distortion is None else distortion.model
        self._model = model if isinstance(model, Distortion) else None
        self.description = source.description

    def __call__(self, frame: SourceFrame, bounds: ScreenBounds) -> DepthMap:
        depth = self._depth(frame.index)
        if self._model is None:
            return depth
        return undistorted_depth(depth, DistortionMap.of(self._model, bounds.camera))


class ShadowNode(Node):
    """Soft shadow by differential rendering (Debevec 1998), temporal samples where it moves."""

    name, writes = "shadow", "shadow"
    effect = SHADOW

    def __init__(
        self,
        context: NodeContext,
        *,
        lamp_points: int = 24,
        ambient_directions: int = 64,
        most_moments: int = 9,
    ) -> None:
        if context.shadow_scene is None:
            raise Unavailable("no scene to cast a shadow")
        self._context, self._scene = context, context.shadow_scene
        self._most_moments = most_moments
        self._cast = CastShadow(
            strength=self._scene.strength,
            lamp_points=lamp_points,
            ambient_directions=ambient_directions,
        )
        self._cast_on_things = CastOnThings(
            strength=self._scene.strength,
            lamp_points=lamp_points,
            ambient_directions=ambient_directions,
        )
        self._caster_cache = CasterCache()
        self._last: tuple[tuple[object, ...], Shadow | None] | None = None
        self.description = (
            f"projected triangles, {lamp_points} samples a light, {ambient_directions} ambient "
            "directions; cached while nothing moves, temporal samples where it moves by a "
            "pixel over the shutter interval"
        )

    def __call__(
        self,
        bounds: ScreenBounds,
        fit: LensFit | None,
        motion: Motion | None,
        plate_depth: DepthMap | None,
    ) -> Shadow | None:
        pose = self._scene.pose(bounds.time_s)
        light = self._scene.light.on_ground(pose.lights, bounds.plate_light)
        moments = self._moments(bounds, fit, motion, light)
        given = (moments, light, fit, plate_depth)
        if self._last is None or not equal_values(self._last[0], given):
            height = self._context.ground_height
            shadow = self._cast(moments, light, height, fit)
            if plate_depth is not None:
                shadow = self._cast_on_things(shadow, moments, light, height, fit, plate_depth)
            self._last = given, shadow
        return self._last[1]

    def _moments(
        self,
        bounds: ScreenBounds,
        fit: LensFit | None,
        motion: Motion | None,
        light: Illumination,
    ) -> tuple[Moment, ...]:
        """Temporal samples of the casters."""
        still = (self._seen(bounds.time_s, bounds),)
        if motion is None:
            return still
        shutter, height = self._context.shutter, self._context.ground_height
        edges = [self._seen(time_s, bounds) for time_s in shutter.edges(bounds.time_s)]
        places = shadow_places(edges, light.lamps, height)
        coc_px, _ = ground_blur(bounds.camera, height, _bounds(places[1]), fit)
        count = sampled_count(list(places), coc_px, self._most_moments)
        if count <= 1:
            return still
        times = shutter.middles(bounds.time_s, count)
        return tuple(self._seen(time_s, bounds) for time_s in times)

    def _seen(self, time_s: float, bounds: ScreenBounds) -> Moment:
        own = time_s == bounds.time_s
        camera = bounds.camera if own else self._context.objects.camera(time_s)
        return Moment(Casters.of(self._scene.pose(time_s), self._caster_cache), camera)


def _bounds(places: Float64) -> Box:
    """The tightest box around points (V, 2) [px]; empty for none."""
    if not len(places):
        return Box(0, 0, 0, 0)
    (x0, y0), (x1, y1) = places.min(axis=0), places.max(axis=0)
    return Box(math.floor(x0), math.floor(y0), math.ceil(x1), math.ceil(y1))


class CompositeShadow(Node):
    """The plate multiplied by the light that the shadow leaves, blurred by the ground's CoC."""

    name, writes = "composite-shadow", "picture"
    effect, lane = SHADOW, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._apply = ApplyShadow(make_reblur(context, "draft"), round_lens=context.aperture.round)
        self._last: tuple[Shadow, BlurredShadow] | None = None  # reused while the object rests
        self.description = "plate times remaining light, blurred by the ground's CoC"

    def __call__(
        self, picture: Picture, shadow: Shadow, frame_box: Box, foreground: Foreground | None
    ) -> Picture:
        if self._last is None or self._last[0] is not shadow:
            self._last = shadow, self._apply.blurred(shadow, frame_box)
        cover = None if foreground is None else foreground.before_shadow
        return self._apply.darken(picture, self._last[1], cover)


def equal_values(first: object, second: object) -> bool:
    """Deep equality of numbers, arrays, tuples and dataclasses of them."""
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return bool(np.array_equal(first, second))
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(equal_values, first, second))
    if is_dataclass(first):
        return all(
            equal_values(getattr(first, f.name), getattr(second, f.name)) for f in fields(first)
        )
    return bool(first == second)


class Reflect(Node):
    """The object rendered by a camera mirrored at the ground plane, with motion blur."""

    name, writes = "reflect", "reflection"
    effect = REFLECTION

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
    """The mirror image over the plate and under the object, blurred by its own CoC."""

    name, writes = "composite-reflection", "picture"
    effect, lane = REFLECTION, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._overlay = OverlayReflection(make_reblur(context))
        self.description = "over the plate, under the object, blurred by its own CoC"

    def __call__(
        self, picture: Picture, reflection: DefocusedLayer, frame_box: Box,
        foreground: Foreground | None,
    ) -> Picture:  # fmt: skip
        cover = None if foreground is None else foreground.before_ground
        return self._overlay(picture, reflection, frame_box, cover)
