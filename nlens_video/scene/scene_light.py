"""What lights the object: the file's lights, and the light around them."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import Note, NoteKind
from nlens_video.core.layers import Float32, Float64, Picture
from nlens_video.core.settings import SUN_STRENGTH, SunSettings
from nlens_video.scene.camera import Camera
from nlens_video.scene.environment import reduce_environment
from nlens_video.scene.illumination import (
    MAX_LAMPS,
    Illumination,
    Lamp,
    PosedLight,
    on_ball,
    sun,
)
from nlens_video.scene.plate_environment import Seat, level_of_ground, plate_environment
from nlens_video.scene.plate_shadows import as_shaded, share_in_shadow, strongest_distant
from nlens_video.scene.plate_sun import PlateSun, toward_sun

_SUN_DIAMETER = math.radians(0.53)
_SEEN_DIAMETER = math.radians(12.0)  # of a sun read off the plate: as it is known that well
_ON_OBJECT = 0.35  # exponent of what its shadow leaves, for its share on the object: level unsure
_OUTSHONE = 8.0  # light of the file's lamps by the plate's from which they have another exposure
_EXPOSED = 0.65  # what they are given then: on surfaces that face them, by the plate's ground [1]
_SAME = 0.9999  # cosine of an angle between directions that are one
_GUESSED = 0.6  # of contact darkening, where lamps are known and the light around them is not [1]


class SceneLight(Struct, frozen=True, eq=False):
    """Light on the object and its ground: the scene file's, and that around it.

    Attributes:
        count: lights of the file that shine; with 0 they are not looked at.
        environment: a reduced environment map; without one the plate gives the light around.
        exposure_given: whether the map's brightness is given; else the plate's level gives it.
        sun: a sun that the user gives in place of the file's suns, None for none.
    """

    count: int
    environment: Illumination | None = None
    exposure_given: bool = False
    sun: SunSettings | None = None

    @property
    def known(self) -> bool:
        """Whether files or options alone give the light; else the plate gives some of it."""
        return self.environment is not None and self.exposure_given and self.sun is None

    @property
    def taken_from_plate(self) -> bool:
        """Whether the plate alone gives the light, and with it a sun if it shows one."""
        return self.count == 0 and self.environment is None and self.sun is None

    @property
    def note(self) -> Note:
        """Description of the light sources."""
        found = []
        if self.count:
            found.append(f"the file's {self.count} light{'s' if self.count > 1 else ''}")
        if self.sun is not None:
            az, el, strength = self.sun.azimuth_deg, self.sun.elevation_deg, self.sun.strength
            where = f"{az:g},{el:g}" if strength is None else f"{az:g},{el:g},{strength:g}"
            found.append(f"--sun {where if self.sun.shines else 'none'}")
        if self.environment is not None:
            count = len(self.environment.lamps)
            level = "" if self.exposure_given else ", at the plate's level"
            found.append(
                f"the environment map ({count or 'no'} light{'' if count == 1 else 's'} of it, "
                f"the rest from around{level})"
            )
        else:
            found.append("the plate's own light")
        text = f"lit by {' and '.join(found)}"
        if self.count + len(self.environment.lamps if self.environment else ()) > MAX_LAMPS:
            return Note(f"{text}; of all lights the first {MAX_LAMPS}", NoteKind.LIGHTS_LIMITED)
        if len(found) == 1 and self.environment is None:
            return Note(
                f"{text}, level and tint as seen, and a sun as far as its shadows tell one; "
                "--sun AZ,EL gives it (degrees right of the view, and up), --env-map MAP.hdr "
                "all light",
                NoteKind.LIGHTS_MISSING,
            )
        return Note(text, NoteKind.INFORMATION)

    def around_without_sun(
        self, plate: Float32, camera: Camera, seat: Seat, lights: tuple[PosedLight, ...],
        strongest: float = 0.0, peak: float = 1.0,
    ) -> Illumination:  # fmt: skip
        """The light beside the file's, at the plate's level unless the map's brightness is given.

        The file's lights stay as bright as they are, unless that burns the object out: Blender
        exports a sun of 3 W/m2 as 2049 lx, and no file tells the exposure of the plate.

        Args:
            plate: scene-linear (h, w, 3), of any size.
            camera: of the frame that it shows.
            seat: where the object stands.
            lights: the file's, at that moment.
            strongest: what `given` is at other moments, at most.
            peak: of the plate's codes.
        """
        if self.environment is not None and self.exposure_given:
            return self.environment
        level, own = level_of_ground(plate, camera, seat), Illumination(self.lamps(lights), None)
        given = max(strongest, self.given(lights, seat))
        exposure = 1.0 if given <= _OUTSHONE * level else _EXPOSED * level / given
        radiance, mirrored = plate_environment(plate, camera, seat, own.scaled(exposure), peak)
        found = reduce_environment(radiance, mirrored=mirrored)
        if self.environment is not None and self.environment.level > 0.0:
            found = self.environment.scaled(found.level / self.environment.level)
        return replace(found, exposure=exposure)

    def given(self, lights: tuple[PosedLight, ...], seat: Seat) -> float:
        """Luminous irradiance of what faces the file's lights on an object."""
        return sum(on_ball(lamp, seat.middle, seat.radius) for lamp in self.lamps(lights))

    def with_sun(
        self,
        light: Illumination,
        picture: Picture,
        camera: Camera,
        seat: Seat,
        lights: tuple[PosedLight, ...],
        seen: PlateSun | None = None,
    ) -> Illumination:
        """Light around the object, its level shared with the sun if there is one.

        How dark a sun's shadow is, the plate's own shadows tell where they show it.

        Args:
            light: from `around_without_sun`.
            picture: the plate.
            camera: of the frame that it shows.
            seat: where the object stands.
            lights: the file's, at that moment.
            seen: a sun that the plate tells of; used where nothing else tells the light.
        """
        if seen is not None and self.taken_from_plate:
            return _with_seen_sun(light, seen, camera, seat)
        toward = self._toward_sun(camera, lights)
        shade = None
        if toward is not None:
            shade = share_in_shadow(picture, camera, seat.ground_y, toward)
        if self.sun is not None and self.sun.shines:
            light = _with_sun(light, self.sun, camera, seat, shade)
        return light if shade is None else replace(light, shadow_left=shade)

    def known_sun(
        self, light: Illumination, camera: Camera, lights: tuple[PosedLight, ...]
    ) -> Lamp | None:
        """The sun among the lamps of `on_object`, None where no file and no option tells it.

        Args:
            light: from `on_object`.
            camera: of the frame.
            lights: the file's, at that moment.
        """
        found = strongest_distant(light.lamps)
        if found is None:
            return None
        if self.environment is not None:
            return found[0]
        toward = None if self.sun is None else toward_sun(self.sun, camera)
        if toward is None:
            own = strongest_distant(self.lamps(lights) if self.count else ())
            toward = None if own is None else -own[0].posed.direction
        same = toward is not None and float(-found[0].posed.direction @ toward) > _SAME
        return found[0] if same else None

    def lamps(self, lights: tuple[PosedLight, ...]) -> tuple[Lamp, ...]:
        """Those of the file's lights that shine: a sun that is given stands in for its suns."""
        kept = (one for one in lights if self.sun is None or one.light.kind != "directional")
        return tuple(map(Lamp, kept))

    def _toward_sun(self, camera: Camera, lights: tuple[PosedLight, ...]) -> Float64 | None:
        """Direction (3,) to a sun of which all but the share of its light is given."""
        if self.environment is not None or (self.sun is not None and self.sun.strength is not None):
            return None
        return self.toward_known_sun(camera, lights)

    def toward_known_sun(self, camera: Camera, lights: tuple[PosedLight, ...]) -> Float64 | None:
        """Direction (3,) to the sun that files or options tell, None where none of them does.

        Args:
            camera: of the frame.
            lights: the file's, at that moment.
        """
        if self.sun is not None:
            return toward_sun(self.sun, camera) if self.sun.shines else None
        own = self.lamps(lights) if self.count else ()
        around = () if self.environment is None else self.environment.lamps
        strongest = strongest_distant((*own, *around))
        return None if strongest is None else -strongest[0].posed.direction

    def on_object(
        self, lights: tuple[PosedLight, ...], plate_light: Illumination | None = None
    ) -> Illumination:
        """Illumination of the object.

        Args:
            lights: the file's, at this moment.
            plate_light: from `with_sun`; None where no plate is known.
        """
        own = self.lamps(lights) if self.count else ()
        rest = plate_light or self.environment
        if rest is not None:
            own = Illumination(own, None).scaled(rest.exposure).lamps
        else:
            rest = Illumination((), None) if own else Illumination.plausible()
        contact = _GUESSED if own and self.environment is None else rest.contact
        lamps = (*own, *rest.lamps)[:MAX_LAMPS]
        return Illumination(lamps, rest.ambient, contact, surround=rest.surround)

    def on_ground(
        self, lights: tuple[PosedLight, ...], plate_light: Illumination | None = None
    ) -> Illumination:
        """Illumination that casts shadows on the ground.

        No lamp whose direction is a guess, but a sun that the plate tells: it is as broad as it is
        unsure.

        Args:
            lights: the file's, at this moment.
            plate_light: from `with_sun`; None where no plate is known.
        """
        if plate_light is not None and plate_light.on_ground is not None:
            return plate_light.on_ground
        light = self.on_object(lights, plate_light)
        told = self.count > 0 or plate_light is not None or self.environment is not None
        if plate_light is not None and plate_light.shadow_left is not None:
            return as_shaded(light, plate_light.shadow_left)
        return light if told else replace(light, lamps=())


def _with_seen_sun(light: Illumination, seen: PlateSun, camera: Camera, seat: Seat) -> Illumination:
    """The light with a sun that the plate tells: on the ground as it is likely, on the object sure.

    The mean of the shadows of all azimuths, each as strong as it is likely, is nearer to the true
    one than any of them or none. The object is lit by a sun that is sure, for it shows a side.
    """
    cast = _with_sun(light, seen.settings, camera, seat, seen.left, _SEEN_DIAMETER)
    lamp = replace(cast.lamps[0], turns=-seen.turns)  # azimuths count clockwise from above
    cast = as_shaded(replace(cast, lamps=(lamp, *cast.lamps[1:])), seen.left)
    if seen.sure:
        left = seen.left**_ON_OBJECT
        light = _with_sun(light, seen.settings, camera, seat, left, _SEEN_DIAMETER)
    return replace(light, on_ground=cast)


def _with_sun(
    light: Illumination,
    given: SunSettings,
    camera: Camera,
    seat: Seat,
    left: Float64 | None,
    diameter: float = _SUN_DIAMETER,
) -> Illumination:
    """The light with its level shared between a sun and what it was."""
    level = light.on_plane(seat.foot)
    strength = SUN_STRENGTH if given.strength is None else given.strength
    kept = np.full(3, 1.0 / (1.0 + strength))
    if given.strength is None and left is not None:
        kept = left  # of each channel: what the sun does not reach has the sky's hue
    toward = toward_sun(given, camera)
    lamp = sun((1.0 - kept) * level / toward[1], -toward)
    rest = _tinted(light, kept)
    return replace(rest, lamps=(Lamp(lamp, diameter), *rest.lamps))


def _tinted(light: Illumination, shares: Float64) -> Illumination:
    """A light of whose red, green and blue shares (3,) are left."""
    lamps = []
    for lamp in light.lamps:
        one = lamp.posed.light
        color = tuple(float(value) for value in shares * one.color)
        lamps.append(replace(lamp, posed=replace(lamp.posed, light=replace(one, color=color))))
    ambient = None if light.ambient is None else shares * light.ambient
    surround = None if light.surround is None else light.surround.scaled(shares)
    return replace(light, lamps=tuple(lamps), ambient=ambient, surround=surround)
