"""The stages of light and shadow, as a pipeline file names them."""

from __future__ import annotations

from functools import partial

import numpy as np

from nlens_video.frames import Box, Picture
from nlens_video.graph.objects import Placement
from nlens_video.graph.tools import LitGround, Made, Tools, Unavailable
from nlens_video.lens import LensFit
from nlens_video.scene.illumination import Illumination
from nlens_video.stages.occlusion import Foreground
from nlens_video.stages.shadow import CastShadow, Darken, Shadow


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

    return Made(run, "the plate's mean colour and what is above it, once")


def make_shadow(tools: Tools, *, lamp_points: int = 24, ambient_directions: int = 64) -> Made:
    """The object's shadow on the ground."""
    ground = _ground(tools)
    cast = CastShadow(
        strength=ground.strength, lamp_points=lamp_points, ambient_directions=ambient_directions
    )

    def run(placement: Placement, fit: LensFit | None) -> Shadow | None:
        posed = ground.pose(placement.time_s)
        vertices, faces = posed.triangles()
        light = ground.light.on_ground(posed.lights)
        height = tools.ground_height()
        return cast(vertices.astype(np.float64), faces, light, placement.camera, height, fit)

    points = f"{lamp_points} points a lamp, {ambient_directions} directions around"
    return Made(run, f"triangles cast on the ground, {points}, numba")


def make_darken(tools: Tools) -> Made:
    """The shadow on the plate."""
    from nlens_video.kernels.scatter import DRAFT, blur_reach, scatter

    stage = Darken(
        scatter=partial(scatter, aperture=tools.aperture, detail=DRAFT),
        reach=partial(blur_reach, aperture=tools.aperture, detail=DRAFT),
        pixel_aspect=tools.pixel_aspect,
    )

    def run(
        picture: Picture, shadow: Shadow, frame_box: Box, foreground: Foreground | None
    ) -> Picture:
        cover = None if foreground is None else foreground.before_ground
        return stage(picture, shadow, frame_box, cover)

    return Made(run, "plate times what is left of its light, blurred as the ground")


def _ground(tools: Tools) -> LitGround:
    if tools.ground is None:
        raise Unavailable("nothing tells what light falls on the ground")
    return tools.ground
