"""What lights the object and its ground: lamps that cast shadows, and light from all around."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.gltf.lights import Light, PosedLight

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Of linear BT.709."""
LAMP_DIAMETER = math.radians(4.0)
"""Apparent size of a light whose size no file tells: glTF's lights are points [rad]."""
_GREY_WORLD = 0.2  # reflectance that the world has on average
_KEY_DIRECTION = np.array([-0.4, -0.8, -0.45]) / np.linalg.norm([-0.4, -0.8, -0.45])
_KEY_SHARE = 0.6  # of the light on the ground; the rest comes from around


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A light that casts shadows.

    Attributes:
        posed: the light.
        diameter: how large it looks from the object [rad].
    """

    posed: PosedLight
    diameter: float = LAMP_DIAMETER


@dataclass(frozen=True, slots=True, eq=False)
class Illumination:
    """The light of one moment.

    Attributes:
        lamps: lights with a place or a direction.
        ambient: irradiance / pi of the light from all around, as a polynomial of the normal
            (9, 3): 1, y, z, x, xy, yz, 3z^2 - 1, xz, x^2 - y^2 (Ramamoorthi and Hanrahan 2001);
            None where nothing is known of it.
    """

    lamps: tuple[Lamp, ...]
    ambient: Float64 | None

    @classmethod
    def of_plate(cls, linear: Float32 | None) -> Illumination:
        """A plausible light for a plate: its level, its tint, brighter above where it is.

        The level is that which shows a world of average reflectance as bright as the plate. Where
        the key light comes from is a guess: from above, half left.

        Args:
            linear: the plate, scene-linear (H, W, 3); None for a plate of average brightness.
        """
        third = 1 if linear is None else max(1, len(linear) // 3)
        plate = np.full((3, 1, 3), _GREY_WORLD) if linear is None else linear.astype(np.float64)
        top, bottom = plate[:third].mean((0, 1)), plate[-third:].mean((0, 1))
        level = float(np.clip(plate.mean((0, 1)) @ LUMINANCE / _GREY_WORLD, 0.05, 5.0))
        lean = float(np.clip((bottom @ LUMINANCE + 0.01) / (top @ LUMINANCE + 0.01), 0.4, 1.0))
        sky = (1.0 - _KEY_SHARE) * level * _tint(top)
        ground = (1.0 - _KEY_SHARE) * level * lean * _tint(bottom)
        strength = math.pi * _KEY_SHARE * level / -float(_KEY_DIRECTION[1])
        key = sun(_tint(plate.mean((0, 1))) * strength, _KEY_DIRECTION)
        return cls((Lamp(key),), hemispheres(sky, ground))

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
    ambient = np.zeros((9, 3))
    ambient[0], ambient[1] = 0.5 * (sky + ground), 0.5 * (sky - ground)
    return ambient


def sun(irradiance: Float64, direction: Float64) -> PosedLight:
    """A directional light that gives a surface facing it an irradiance (3,)."""
    intensity = float(irradiance.max())
    color = tuple(float(value) / intensity if intensity > 0.0 else 1.0 for value in irradiance)
    light = Light(
        kind="directional",
        color=color,
        intensity=intensity,
        range=None,
        inner_cone=0.0,
        outer_cone=math.pi / 4.0,
    )
    return PosedLight(light, np.zeros(3), direction)


def _tint(color: Float64) -> Float64:
    """Colour of the light behind a mean colour (3,): half its hue is taken for the surfaces'."""
    hue = np.sqrt(np.maximum(color, 1e-4))
    return np.asarray(hue / (hue @ LUMINANCE))
