"""The stages of light and shadow, as a pipeline file names them."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from functools import partial

import numpy as np

from nlens_video.frames import BlurredLayer, Box, Picture
from nlens_video.graph.objects import Placement
from nlens_video.graph.tools import LitGround, Made, Tools, Unavailable
from nlens_video.lens import LensFit
from nlens_video.scene.casters import Casters, Surface
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.mesh import Geometry
from nlens_video.stages.darken import Darken, Shadow
from nlens_video.stages.occlusion import Foreground
from nlens_video.stages.shadow import CastShadow


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


def make_shadow(tools: Tools, *, lamp_points: int = 24, ambient_directions: int = 64) -> Made:
    """The object's shadow on the ground."""
    ground = _ground(tools)
    cast = CastShadow(
        strength=ground.strength, lamp_points=lamp_points, ambient_directions=ambient_directions
    )
    surfaces: dict[Geometry, Surface] = {}
    before: tuple[tuple[object, ...], Shadow | None] | None = None

    def run(placement: Placement, fit: LensFit | None) -> Shadow | None:
        nonlocal before
        posed = ground.pose(placement.time_s)
        casters = Casters.of(posed, surfaces)
        light = ground.light.on_ground(posed.lights)
        given = (casters, light, placement.camera, fit)
        if before is None or not alike(before[0], given):
            height = tools.ground_height()
            before = given, cast(casters, light, placement.camera, height, fit)
        return before[1]

    points = f"{lamp_points} points a lamp, {ambient_directions} directions around"
    return Made(run, f"triangles cast on the ground, {points}, numba; again when something moves")


def make_darken(tools: Tools) -> Made:
    """The shadow on the plate."""
    from nlens_video.kernels.scatter import DRAFT, blur_reach, scatter

    stage = Darken(
        scatter=partial(scatter, aperture=tools.aperture, detail=DRAFT),
        reach=partial(blur_reach, aperture=tools.aperture, detail=DRAFT),
        pixel_aspect=tools.pixel_aspect,
    )

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
