"""Lights of the file and illumination: lamps, ambient light, irradiance of the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.object_motion import turned_about_up
from nlens_video.scene.surround import Surround

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of linear BT.709."""
LAMP_DIAMETER = math.radians(4.0)
"""Apparent size of a light whose size no file tells: glTF's lights are points [rad]."""
_KEY_DIRECTION = np.array([-0.4, -0.8, -0.45]) / np.linalg.norm([-0.4, -0.8, -0.45])
_KEY_SHARE = 0.6  # of the light on the ground; the rest comes from around
_UP = np.array([0.0, 1.0, 0.0])
_INSIDE = 0.25  # of an object's radius: no surface is nearer to a lamp than that [1]
_EVERY_TURN = 6  # of `Lamp.turns`: enough for what surfaces that stand get of them
MAX_LAMPS = 32
"""Maximum number of lights in rendering."""
Kind = Literal["directional", "point", "spot"]
_KINDS: tuple[Kind, ...] = ("directional", "point", "spot")


class Light(Struct, frozen=True, kw_only=True):
    """A light as the file declares it.

    Attributes:
        kind: directional, point or spot.
        color: linear RGB.
        intensity: directional: illuminance [lx]; point and spot: luminous intensity [cd]. A white
            Lambert surface facing a directional light has the radiance intensity / pi.
        range: distance beyond which it has no effect, or None for no limit [scene unit].
        inner_cone: half angle of the fully lit cone of a spot [rad].
        outer_cone: half angle where a spot ends [rad].
    """

    kind: Kind
    color: tuple[float, ...]
    intensity: float
    range: float | None = None
    inner_cone: float = 0.0
    outer_cone: float = math.pi / 4.0

    @property
    def rgb(self) -> Float64:
        """Intensity in each channel (3,)."""
        return np.array(self.color) * self.intensity

    def scaled(self, gain: float) -> Light:
        """The same light, so many times as bright."""
        return replace(self, intensity=gain * self.intensity)


class PosedLight(Struct, frozen=True, eq=False):
    """A light at one moment.

    Attributes:
        light: its properties.
        position: in the world (3,) [scene unit].
        direction: unit vector (3,) along which it shines.
        in_surround: whether smooth surfaces mirror it by `Illumination.surround`.
    """

    light: Light
    position: Float64
    direction: Float64
    in_surround: bool = False


def read_lights(document: Document) -> tuple[tuple[int, Light], ...]:
    """Lights of the default scene with the nodes that carry them.

    Raises:
        SceneError: an unknown kind, or a wrong number.
    """
    extension = document.root.extension("KHR_lights_punctual")
    declared = extension.children("lights") if extension else ()
    lights = tuple(_read_light(item) for item in declared)
    carried = []
    for index, node in enumerate(document.items("nodes")):
        reference = node.extension("KHR_lights_punctual")
        if reference is not None:
            carried.append((index, lights[reference.integer("light", below=len(lights))]))
    return tuple(carried)


def _read_light(item: Fields) -> Light:
    spot = item.child("spot")
    outer = min(spot.number("outerConeAngle", math.pi / 4.0), math.pi / 2.0)
    return Light(
        kind=item.choice("type", _KINDS),
        color=item.color("color", (1.0, 1.0, 1.0)),
        intensity=item.not_negative("intensity", 1.0),
        range=item.positive("range"),
        inner_cone=max(0.0, min(spot.number("innerConeAngle", 0.0), outer)),
        outer_cone=outer,
    )


def pose_light(light: Light, world: Float64) -> PosedLight:
    """A light on a node whose world matrix is (4, 4); it shines along the node's -Z.

    Raises:
        SceneError: the matrix has no direction.
    """
    forward = -world[:3, 2]
    length = float(np.linalg.norm(forward))
    if length == 0.0:
        raise SceneError("the matrix of its node has no direction; give it a scale other than 0")
    return PosedLight(light, world[:3, 3].copy(), forward / length)


class Lamp(Struct, frozen=True, eq=False):
    """A light that casts shadows.

    Attributes:
        posed: the light.
        diameter: how large it looks from the object [rad].
        turns: angles about the vertical, counterclockwise from above, by which a distant light may
            stand beside its direction, each as likely as the others (T,) [rad]; None where its
            direction is known.
    """

    posed: PosedLight
    diameter: float = LAMP_DIAMETER
    turns: Float64 | None = None


class Illumination(Struct, frozen=True, eq=False):
    """The light of one moment.

    Attributes:
        lamps: lights with a place or a direction.
        ambient: irradiance / pi of the light from all around, as a polynomial of the normal
            (9, 3): 1, y, z, x, xy, yz, 3z^2 - 1, xz, x^2 - y^2 (Ramamoorthi and Hanrahan 2001);
            None where nothing is known of it.
        contact: factor on the darkening where a body blocks the light from around; less than 1
            where that light is a guess beside known lamps [1].
        exposure: factor on the lights of the file, which are not among the lamps yet [1].
        surround: the ambient light as smooth surfaces mirror it; None where that is not known.
        shadow_left: share of the ground's light (3,) that the strongest lamp's shadow leaves, as
            the plate's own shadows show it; None where they do not [1].
        on_ground: the light that casts shadows on the ground, where it is another.
        provisional: whether it is of a black or white picture, before one that tells it.
    """

    lamps: tuple[Lamp, ...]
    ambient: Float64 | None
    contact: float = 1.0
    exposure: float = 1.0
    surround: Surround | None = None
    shadow_left: Float64 | None = None
    on_ground: Illumination | None = None
    provisional: bool = False

    @classmethod
    def plausible(cls) -> Illumination:
        """The light where no file and no plate tells it: a key light from above, half left."""
        key = np.full(3, math.pi * _KEY_SHARE / -float(_KEY_DIRECTION[1]))
        around = np.full(3, 1.0 - _KEY_SHARE)
        return cls((Lamp(sun(key, _KEY_DIRECTION)),), hemispheres(around, around))

    def scaled(self, gain: float) -> Illumination:
        """So many times as bright."""
        if gain == 1.0:
            return self
        lamps = tuple(
            replace(lamp, posed=replace(lamp.posed, light=lamp.posed.light.scaled(gain)))
            for lamp in self.lamps
        )
        ambient = None if self.ambient is None else gain * self.ambient
        surround = None if self.surround is None else self.surround.scaled(gain)
        on_ground = None if self.on_ground is None else self.on_ground.scaled(gain)
        return replace(self, lamps=lamps, ambient=ambient, surround=surround, on_ground=on_ground)

    def on_plane(self, point: Float64) -> Float64:
        """Irradiance (3,) of the ground at a point (3,), by all that is known of the light."""
        lamps = (from_lamp(lamp, point) for lamp in self.lamps if reaches(lamp, float(point[1])))
        return np.asarray(sum(lamps, self.irradiance_around(_UP)))

    @property
    def level(self) -> float:
        """Luminous irradiance, averaged over surfaces of all directions, by distant light [1]."""
        around = 0.0 if self.ambient is None else math.pi * float(self.ambient[0] @ LUMINANCE)
        far = (one.posed.light for one in self.lamps if one.posed.light.kind == "directional")
        return around + sum(0.25 * one.intensity * float(one.color @ LUMINANCE) for one in far)

    def irradiance_around(self, normal: Float64) -> Float64:
        """Irradiance (3,) that the ambient light gives a surface of a unit normal (3,)."""
        if self.ambient is None:
            return np.zeros(3)
        return np.asarray(math.pi * np.maximum(polynomial(normal) @ self.ambient, 0.0))


def polynomial(directions: Float64) -> Float64:
    """The nine terms of `Illumination.ambient` (..., 9) for unit vectors (..., 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    terms = [np.ones_like(x), y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y]
    return np.stack(terms, axis=-1)


def hemispheres(sky: Float64, ground: Float64) -> Float64:
    """Ambient light (9, 3) between a sky (3,) on normals up and a ground (3,) on normals down."""
    return np.stack([0.5 * (sky + ground), 0.5 * (sky - ground), *np.zeros((7, 3))])


def sun(irradiance: Float64, direction: Float64) -> PosedLight:
    """A directional light that gives a surface facing it an irradiance (3,)."""
    intensity = float(irradiance.max())
    color = tuple(float(value) / intensity if intensity > 0.0 else 1.0 for value in irradiance)
    light = Light(kind="directional", color=color, intensity=intensity)
    return PosedLight(light, np.zeros(3), direction)


def reaches(lamp: Lamp, ground_y: float) -> bool:
    """Whether a lamp shines on a ground of that height from above."""
    if lamp.posed.light.kind == "directional":
        return bool(lamp.posed.direction[1] < 0.0)
    return bool(lamp.posed.position[1] > ground_y)


def on_ball(lamp: Lamp, middle: Float64, radius: float) -> float:
    """Luminous irradiance of surfaces in the middle of a ball that face a lamp.

    Its range and its cone dim it as at the part of the ball where it is the brightest; 0 where its
    light does not reach the ball.

    Args:
        lamp: the lamp.
        middle: of the ball (3,) [scene unit].
        radius: of it [scene unit].
    """
    posed, light = lamp.posed, lamp.posed.light
    strength = light.intensity * float(np.array(light.color) @ LUMINANCE)
    if light.kind == "directional":
        return strength
    away = middle - posed.position
    distance = float(np.linalg.norm(away))
    if light.range is not None and distance > radius:
        strength *= max(0.0, 1.0 - ((distance - radius) / light.range) ** 4)
    if light.kind == "spot" and distance > radius:
        aside = math.acos(min(max(float(away @ posed.direction) / distance, -1.0), 1.0))
        nearest = max(aside - math.asin(radius / distance), 0.0)
        strength *= float(_in_cone(light, np.cos(nearest)))
    return strength / max(distance, _INSIDE * radius, math.sqrt(np.finfo(np.float64).tiny)) ** 2


def _in_cone(light: Light, cosine: Float64) -> Float64:
    """Share of a spot's light at angles off its axis: "Inner and Outer Cone Angles"."""
    inner, outer = math.cos(light.inner_cone), math.cos(light.outer_cone)
    return np.asarray(np.clip((cosine - outer) / max(1e-3, inner - outer), 0.0, 1.0) ** 2)


def from_lamp(lamp: Lamp, ground: Float64, normal: Float64 = _UP) -> Float64:
    """Irradiance (..., 3) of points (..., 3) by a lamp; the arguments are as of `strength_at`."""
    given = strength_at(lamp, ground, normal)[..., None] * lamp.posed.light.rgb
    return np.broadcast_to(given, ground.shape)


def strength_at(lamp: Lamp, ground: Float64, normal: Float64 = _UP) -> Float64:
    """Irradiance of points (..., 3) by a lamp of intensity 1, as if nothing hid it: (...).

    It is one number where all have the same. Their surface has unit normals (3,) or (..., 3), by
    default that of the ground.
    """
    light, direction = lamp.posed.light, lamp.posed.direction
    if light.kind == "directional":
        turned = [direction]
        if lamp.turns is not None:
            turned = [*turned_about_up(direction, lamp.turns[::_EVERY_TURN])]
        return np.asarray(np.mean([np.maximum(0.0, -(normal @ one)) for one in turned], axis=0))
    toward = [place - ground[..., axis] for axis, place in enumerate(lamp.posed.position)]
    squared = np.maximum(_dot(toward, toward), np.finfo(np.float64).tiny)
    distance = np.sqrt(squared)
    facing = _dot(toward, [normal[..., axis] for axis in range(3)]) / distance
    found = np.maximum(facing, 0.0) / squared
    if light.range is not None:
        found = found * np.clip(1.0 - (squared / light.range**2) ** 2, 0.0, 1.0)
    if light.kind == "spot":
        found = found * _in_cone(light, _dot(toward, -direction) / distance)
    return found


def _dot(one: Sequence[Float64], other: Sequence[Float64] | Float64) -> Float64:
    """Dot products (...) of vectors (3, ...): NumPy is slow along a last axis of three."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])
