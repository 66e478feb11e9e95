"""Node of the light around the object, estimated from the plate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from nlens_video.effects.beginning import Beginning
from nlens_video.graph.base.node import Node, Unavailable
from nlens_video.scene.plate_environment import PLATE_COLUMNS, USUAL_LEVEL, Seat, level_of_ground

if TYPE_CHECKING:
    from nlens_video.core.layers import Picture
    from nlens_video.core.settings import SunSettings
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.scene.illumination import Illumination
    from nlens_video.scene.plate_sun import PlateSun


class EstimateLight(Node):
    """The light around the object from the first frame that tells it, beside the file's lights.

    Where that frame is not known beforehand, and the plate fades in to it, the file's lights are
    dimmed as far as the plate is darker than plates are.
    """

    name, writes = "estimate-light", "plate_light"
    stateful = True

    def __init__(self, context: NodeContext) -> None:
        scene = context.shadow_scene
        if scene is None:
            raise Unavailable("no scene to light")
        if scene.pre_rendered and scene.light.sun is None:
            raise Unavailable("pre-rendered layers are lit already")
        if scene.light.known:
            raise Unavailable("the environment map and --env-exposure give the light")
        self._context, self._scene = context, scene
        self._light: Illumination | None = None
        self._without_sun: Illumination | None = None
        self._sun: PlateSun | None = None
        self._beginning, self._settled, self._dimmed = Beginning(), False, False
        self._told = context.first_lit_frame()
        self.description = "the first frame on a sphere around the object, continued beyond it"

    def __call__(self, picture: Picture) -> Illumination:
        time_s = 0.0
        if not self._settled:
            self._settled = self._beginning.ends(picture)
            if self._told is not None:
                picture, time_s, self._settled = self._told.picture, self._told.time_s, True
            if self._settled or self._dimmed or not self._beginning.rests:
                self._light = self._without_sun = None
        if self._light is None:
            posed = self._scene.pose(time_s)
            seat = Seat.of(posed.bounds(), self._context.ground_height)
            rows = max(1, round(PLATE_COLUMNS * picture.height / picture.width))
            plate = picture.downsample(PLATE_COLUMNS, rows)
            camera, light = self._context.objects.camera(time_s), self._scene.light
            if self._without_sun is None:
                self._without_sun = light.around_without_sun(
                    plate, camera, seat, posed.lights, self._strongest(), picture.peak
                )
                if light.taken_from_plate and self._settled and self._context.read_sun is not None:
                    self._sun = self._context.read_sun(picture, camera, seat.ground_y)
            found = light.with_sun(
                self._without_sun, picture, camera, seat, posed.lights, self._sun
            )
            self._dimmed = not self._settled and self._beginning.fades_in
            if self._dimmed:
                level = level_of_ground(plate, camera, seat) / USUAL_LEVEL
                found = replace(found, exposure=min(found.exposure, level))
            self._light = replace(found, provisional=not self._settled)
        return self._light

    def _strongest(self) -> float:
        """Light of the file's lights on what faces them, when they give most of it."""
        given = []
        for time_s in self._scene.moments:
            posed = self._scene.pose(time_s)
            seat = Seat.of(posed.bounds(), self._context.ground_height)
            given.append(self._scene.light.given(posed.lights, seat))
        return max(given)

    @property
    def notes(self) -> tuple[str, ...]:
        """The sun that was read off the plate."""
        return () if self._sun is None else (self._sun.note,)

    @property
    def likeliest_sun(self) -> SunSettings | None:
        """The sun that was read off the plate, sure or not; None where none was looked for."""
        return None if self._sun is None else self._sun.settings

    def under_sun_of(self, context: NodeContext) -> EstimateLight:
        """The node for another sun, whose light from around is not estimated again."""
        other = EstimateLight(context)
        other._without_sun, other._sun = self._without_sun, self._sun
        other._settled = True
        return other
