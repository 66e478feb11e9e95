"""The stages of light and shadow, as a pipeline file names them."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass

import numpy as np

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    Float64,
    Picture,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.motion_blur import Motion, sampled_count
from nlens_video.effects.shadow.apply import Darken, Shadow
from nlens_video.effects.shadow.casters import Casters, Surface
from nlens_video.effects.shadow.projection import Moment, shadow_places
from nlens_video.effects.shadow.shadow import CastShadow, ground_blur
from nlens_video.graph.nodes.context import (
    LitGround,
    Made,
    Tools,
    Unavailable,
)
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.graph.nodes.through_lens import through_lens
from nlens_video.scene.gltf.meshes import Geometry
from nlens_video.scene.illumination import Illumination
from nlens_video.stages.composite import Foreground


def make_light(tools: Tools) -> Made:
    """The light on the object, from the plate where no file tells it."""
    ground = _ground(tools)
    if ground.pre_rendered:
        raise Unavailable("pre-rendered layers bring their light with them")
    if ground.light.known:
        raise Unavailable("the light is known")

    def run(picture: Picture) -> Illumination:
        ground.light.look_at(lambda: picture.linear(Box(0, 0, picture.width, picture.height)))
        return ground.light.on_object(())

    return Made(run, "the plate's mean colour and what is above it, once", remembers=True)


def make_shadow(
    tools: Tools,
    *,
    lamp_points: int = 24,
    ambient_directions: int = 64,
    most_moments: int = 9,
) -> Made:
    """The object's shadow on the ground, blurred by its motion where that shows."""
    ground = _ground(tools)
    cast = CastShadow(
        strength=ground.strength, lamp_points=lamp_points, ambient_directions=ambient_directions
    )
    surfaces: dict[Geometry, Surface] = {}
    before: tuple[tuple[object, ...], Shadow | None] | None = None

    def seen(time_s: float, placement: Placement) -> Moment:
        own = time_s == placement.time_s
        camera = placement.camera if own else tools.objects.camera(time_s)
        return Moment(Casters.of(ground.pose(time_s), surfaces), camera)

    def run(placement: Placement, fit: LensFit | None, motion: Motion | None) -> Shadow | None:
        nonlocal before
        height = tools.ground_height()
        light = ground.light.on_ground(ground.pose(placement.time_s).lights)
        moments = [seen(placement.time_s, placement)]
        if motion is not None:
            edges = [seen(time_s, placement) for time_s in tools.shutter.edges(placement.time_s)]
            places = shadow_places(edges, light.lamps, height)
            coc_px, _ = ground_blur(placement.camera, height, _around(places[1]), fit)
            count = sampled_count(list(places), coc_px, most_moments)
            times = tools.shutter.middles(placement.time_s, count)
            moments = [seen(time_s, placement) for time_s in times] if count > 1 else moments
        given = (tuple(moments), light, fit)
        if before is None or not alike(before[0], given):
            before = given, cast(moments, light, height, fit)
        return before[1]

    points = f"{lamp_points} points a lamp, {ambient_directions} directions around"
    return Made(
        run,
        f"triangles cast on the ground, {points}, numba; again when something moves, at several "
        "moments where it moves by a pixel while the shutter is open",
    )


def _around(places: Float64) -> Box:
    """The least box of pixels round some places (V, 2); empty where there are none."""
    if not len(places):
        return Box(0, 0, 0, 0)
    (x0, y0), (x1, y1) = places.min(axis=0), places.max(axis=0)
    return Box(math.floor(x0), math.floor(y0), math.ceil(x1), math.ceil(y1))


def make_darken(tools: Tools) -> Made:
    """The shadow on the plate."""
    stage = Darken(through_lens(tools, "draft"))
    before: tuple[Shadow, BlurredLayer] | None = None  # a resting object's is the same one

    def run(
        picture: Picture, shadow: Shadow, frame_box: Box, foreground: Foreground | None
    ) -> Picture:
        nonlocal before
        if before is None or before[0] is not shadow:
            before = shadow, stage.blurred(shadow, frame_box)
        cover = None if foreground is None else foreground.before_ground
        return stage.taken(picture, before[1], cover)

    return Made(run, "plate times what is left of its light, blurred as the ground")


def alike(first: object, second: object) -> bool:
    """Whether two values hold the same numbers: arrays, tuples, and dataclasses of them."""
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return bool(np.array_equal(first, second))
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(alike, first, second))
    if is_dataclass(first):
        return all(alike(getattr(first, f.name), getattr(second, f.name)) for f in fields(first))
    return bool(first == second)


def _ground(tools: Tools) -> LitGround:
    if tools.ground is None:
        raise Unavailable("nothing tells what light falls on the ground")
    return tools.ground
