"""Nodes of the shadow that the object casts on the ground and what stands on it."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from msgspec.structs import astuple, replace

from nlens_video.cameras.placement import contact_point
from nlens_video.core.box import Box
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.distortion_apply import DistortionMap, undistorted_depth
from nlens_video.effects.foreground.received_shadow import (
    Sunlight,
    ground_light,
    sunlit_fraction,
)
from nlens_video.effects.motion_blur import sampled_count
from nlens_video.effects.occlusion_cues import MovingThings
from nlens_video.effects.planner import SHADOW
from nlens_video.effects.shadow.apply import (
    ApplyShadow,
    Shade,
    behind_foreground,
    ground_blur,
    multiply,
)
from nlens_video.effects.shadow.cast import CastShadow, shadow_places
from nlens_video.effects.shadow.cast_on_things import CastOnThings
from nlens_video.effects.shadow.casters import CasterCache, Casters, FrameCasters, Moment
from nlens_video.graph.base.node import LARGEST_MOMENTS, Node, Unavailable
from nlens_video.graph.nodes.reblur import make_reblur
from nlens_video.scene.patches import Patches

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, DepthMap, Float64, Picture
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.motion_blur import Motion
    from nlens_video.effects.occlusion_cues import OcclusionCue
    from nlens_video.effects.shadow.apply import BlurredShadow, Shadow
    from nlens_video.graph.base.context import NodeContext, ShadowScene
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
        depth = self._depth(frame)
        if self._model is None:
            return depth
        return undistorted_depth(depth, DistortionMap.of(self._model, bounds.camera))


class ShadowCasters(Node):
    """What casts the shadow, at temporal samples where it moves, and the light on the ground."""

    name, writes = "shadow-casters", "casters"
    effect = SHADOW
    ranges = (("most_moments", 1, LARGEST_MOMENTS),)

    def __init__(self, context: NodeContext, *, most_moments: int = 9) -> None:
        self._context, self._scene = context, _shadow_scene(context)
        self._most_moments = most_moments
        self._cache = CasterCache()
        # far from the world's origin float32 would let the shadow tremble
        self._origin = self._scene.pose(0.0).origin
        self.description = (
            "triangles and light on the ground, temporal samples where they move by a pixel over "
            "the shutter interval"
        )

    def __call__(
        self, bounds: ScreenBounds, fit: LensFit | None, motion: Motion | None
    ) -> FrameCasters:
        pose = self._scene.pose(bounds.time_s).about_origin()
        bounds = replace(bounds, camera=bounds.camera.about(self._origin))
        light = self._scene.light.on_ground(pose.lights, bounds.plate_light)
        moments = self._moments(bounds, fit, motion, light)
        return FrameCasters(moments=moments, light=light, pose=pose, camera=bounds.camera)

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
        height = _height(self._context, self._origin)
        shutter = self._context.objects.shutter_at(self._context.shutter, bounds.time_s)
        edges = [self._seen(time_s, bounds) for time_s in shutter.edges(bounds.time_s)]
        if len({edge.casters.count for edge in edges}) > 1:
            return still  # something appears or vanishes meanwhile
        places = shadow_places(edges, light.lamps, height)
        coc_px, _ = ground_blur(bounds.camera, height, _bounds(places[1]), fit)
        count = sampled_count(list(places), coc_px, self._most_moments)
        if count <= 1:
            return still
        times = shutter.middles(bounds.time_s, count)
        return tuple(self._seen(time_s, bounds) for time_s in times)

    def _seen(self, time_s: float, bounds: ScreenBounds) -> Moment:
        camera = bounds.camera
        if time_s != bounds.time_s:
            camera = self._context.objects.camera(time_s).about(self._origin)
        pose = self._scene.pose(time_s).about_origin()
        return Moment(Casters.of(pose, self._cache), camera)


class ShadowNode(Node):
    """Soft shadow by differential rendering (Debevec 1998)."""

    name, writes = "shadow", "shadow"
    effect, lane = SHADOW, "composite"
    ranges = ("lamp_points", 1, 4096), ("ambient_directions", 1, 4096)

    def __init__(
        self, context: NodeContext, *, lamp_points: int = 24, ambient_directions: int = 64
    ) -> None:
        self._context, self._scene = context, _shadow_scene(context)
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
        # a layer's own colours are not those of the GLB that casts its shadow
        first = self._scene.pose(0.0)
        self._patches = None if self._scene.pre_rendered else Patches.of(first)
        self._height = _height(context, first.origin)
        self._last: tuple[tuple[object, ...], Shadow | None] | None = None
        self.description = (
            f"projected triangles, {lamp_points} samples a light, {ambient_directions} ambient "
            "directions; cached while nothing moves"
        )

    def __call__(
        self, casters: FrameCasters, fit: LensFit | None, plate_depth: DepthMap | None
    ) -> Shadow | None:
        given = (casters.moments, casters.light, fit, plate_depth)
        if self._last is None or not equal_values(self._last[0], given):
            shadow = self._shadow(casters, fit, plate_depth)
            if shadow is not None and self._context.occlusion is not None:

                def shade() -> Shade | None:
                    """In the shadow of what moves."""
                    sunlight = self._sunlight(casters)
                    if sunlight is None:
                        return None
                    light = casters.light
                    rest = tuple(one for one in light.lamps if one is not sunlight.sun)
                    around = replace(casters, light=replace(light, lamps=rest))
                    return Shade(self._shadow(around, fit, plate_depth), sunlight.in_shadow)

                shadow = replace(shadow, shade=cache(shade))
            self._last = given, shadow
        return self._last[1]

    def _shadow(
        self, casters: FrameCasters, fit: LensFit | None, plate_depth: DepthMap | None
    ) -> Shadow | None:
        moments, light, height = casters.moments, casters.light, self._height
        patches = None if self._patches is None else self._patches.at(casters.pose)
        shadow = self._cast(moments, light, height, fit, patches)
        if plate_depth is None:
            return shadow
        return self._cast_on_things(shadow, moments, light, height, fit, plate_depth)

    def _sunlight(self, casters: FrameCasters) -> Sunlight | None:
        """The sun that what moves may hide from the ground; None where none is known."""
        light, pose = casters.light, casters.pose
        sun = self._scene.light.known_sun(light, casters.camera, pose.lights)
        contact = contact_point(pose.vertices(), self._height)
        return None if light.ambient is None else Sunlight.known(sun, light, light, contact)


def _shadow_scene(context: NodeContext) -> ShadowScene:
    if context.shadow_scene is None:
        raise Unavailable("no scene to cast a shadow")
    return context.shadow_scene


def _height(context: NodeContext, origin: Float64 | None) -> float:
    """Of the ground above the scene's origin [scene unit]."""
    return context.ground_height - (0.0 if origin is None else float(origin[1]))


def _bounds(places: Float64) -> Box:
    """The tightest box around points (V, 2) [px]; empty for none."""
    if not len(places):
        return Box(0, 0, 0, 0)
    x, y = places.T  # NumPy is slow along an axis of two
    return Box(math.floor(x.min()), math.floor(y.min()), math.ceil(x.max()), math.ceil(y.max()))


class BlurShadow(Node):
    """What darkens the plate: the shadow blurred by the ground's CoC, behind the foreground."""

    name, writes = "blur-shadow", "darkening"
    effect, lane = SHADOW, "composite"

    def __init__(self, context: NodeContext) -> None:
        self._apply = ApplyShadow(make_reblur(context, "draft"), round_lens=context.aperture.round)
        # both are reused while the object rests
        self._last: tuple[Shadow, BlurredShadow] | None = None
        self._last_shade: tuple[Shadow, BlurredShadow | None, float] | None = None
        self.description = (
            "blurred by the ground's CoC; where what moves hides the sun, of the other light alone"
        )

    def __call__(
        self, picture: Picture, shadow: Shadow, frame_box: Box, foreground: Foreground | None,
        occlusion_cue: OcclusionCue | None,
    ) -> BlurredLayer:  # fmt: skip
        if self._last is None or self._last[0] is not shadow:
            self._last = shadow, self._apply.blurred(shadow, frame_box)
        blurred = self._last[1]
        if isinstance(occlusion_cue, MovingThings) and len(occlusion_cue.feet):
            blurred = self._beside(occlusion_cue, picture, shadow, blurred, frame_box)
        cover = None if foreground is None else foreground.before_shadow
        return behind_foreground(blurred, picture, cover)

    def _beside(
        self, things: MovingThings, picture: Picture, shadow: Shadow, blurred: BlurredShadow,
        frame_box: Box,
    ) -> BlurredShadow:  # fmt: skip
        """The shadow where a part of the ground lies in that of what moves."""
        if self._last_shade is None or self._last_shade[0] is not shadow:
            shade = None if shadow.shade is None else shadow.shade()
            lit = None
            if shade is not None and shade.shadow is not None:
                lit = self._apply.blurred(shade.shadow, frame_box)
            self._last_shade = shadow, lit, 1.0 if shade is None else shade.left
        _, lit, left = self._last_shade
        if left >= 1.0:
            return blurred
        ground = ground_light(picture, things.background(picture))
        return blurred.mixed(lit, ground.box, sunlit_fraction(ground, left))


class CompositeShadow(Node):
    """The plate multiplied by the light that the shadow leaves."""

    name, writes = "composite-shadow", "picture"
    effect, lane = SHADOW, "composite"
    description = "plate times remaining light"

    def __call__(self, picture: Picture, darkening: BlurredLayer) -> Picture:
        return multiply(picture, darkening)


def equal_values(first: object, second: object) -> bool:
    """Deep equality of numbers, arrays, tuples and structs of them."""
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return bool(np.array_equal(first, second))
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(equal_values, first, second))
    if isinstance(first, Struct) and isinstance(second, Struct):
        return equal_values(astuple(first), astuple(second))
    return bool(first == second)
