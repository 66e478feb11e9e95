"""Samples of a light: points of a lamp's disc, or directions to the light from around.

Each is a projection of the world on the ground.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.effects.shadow.ambient import hemisphere, hemisphere_spacing
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Lamp
from nlens_video.scene.object_motion import turned_about_up
from nlens_video.scene.patches import R2

_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_SPREAD = 3  # times the points of a lamp whose direction is known


class LightSamples(Struct, frozen=True, eq=False):
    """Samples of a light, each of the same part of it.

    Attributes:
        points: (x, y, z, 1), or directions towards distant light (x, y, z, 0) (N, 4).
        count: samples that they stand for, neglected ones included.
        spacing: angle between neighbours whose pattern would be seen, 0 where none is [rad].
    """

    points: Float64
    count: int
    spacing: float

    @classmethod
    def of_lamp(cls, lamp: Lamp, middle: Float64, count: int) -> LightSamples:
        """So many points of a lamp, or more where its direction is not known.

        Args:
            lamp: the lamp.
            middle: of the object (3,) [scene unit].
            count: points of a lamp whose direction is known.
        """
        if lamp.turns is None:
            return cls(lamp_points(lamp, middle, count), count, 0.0)
        count *= _SPREAD
        spread = math.sqrt(12.0) * float(np.std(lamp.turns))  # width of an even distribution
        return cls(lamp_points(lamp, middle, count), count, spread / count)

    @classmethod
    def of_sky(cls, ambient: Float64 | None, count: int) -> LightSamples:
        """Directions to the light from above, as of `hemisphere`."""
        return cls(hemisphere(count, ambient), count, hemisphere_spacing(count))

    @property
    def soft(self) -> bool:
        """Whether the shadow has no sharp edges, so that a coarse grid holds it."""
        return self.spacing > 0.0


def lamp_points(lamp: Lamp, middle: Float64, count: int) -> Float64:
    """Points (N, 4) of a lamp's disc as seen from the object; w = 0 for a distant lamp.

    Where its direction is unsure, each is turned about the vertical by another of `Lamp.turns`; a
    single one stays where the lamp is.

    Args:
        lamp: the lamp.
        middle: of the object (3,) [scene unit].
        count: number of points, N.
    """
    posed = lamp.posed
    far = posed.light.kind == "directional"
    toward = -posed.direction if far else posed.position - middle
    distance = float(np.linalg.norm(toward))
    axis = toward / max(distance, np.finfo(np.float64).tiny)
    first = _cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    second = _cross(axis, first)
    number = np.arange(count)
    radius = math.tan(0.5 * lamp.diameter) * distance * np.sqrt((number + 0.5) / count)
    aside = np.cos(number * _GOLDEN)[:, None] * first + np.sin(number * _GOLDEN)[:, None] * second
    places = (toward if far else posed.position) + radius[:, None] * aside
    if lamp.turns is not None and count > 1:
        rank = np.argsort(np.argsort(number * R2[0] % 1.0))  # so that all turns come up alike
        places = turned_about_up(places, lamp.turns[rank * len(lamp.turns) // count])
    return np.column_stack([places, np.full(count, 0.0 if far else 1.0)])


def project_along_light(lights: Float64, ground_y: float, camera: Camera) -> Float64:
    """Projection of world points along lights (N, 4) on the ground, then on the screen.

    Matrices (N, 3, 4) to homogeneous pixel positions, whose last coordinate is positive before the
    camera for points below the light.
    """
    plane = np.array([0.0, 1.0, 0.0, -ground_y])
    intrinsics = np.array(
        [[camera.fx, 0.0, -camera.cx], [0.0, -camera.fy, -camera.cy], [0.0, 0.0, -1.0]]
    )
    screen = intrinsics @ camera.camera_from_world[:3]
    # on the ground a point p lies at (light . plane) p - (p . plane) light
    own = (lights @ plane)[:, None, None] * screen
    return np.asarray(own - (lights @ screen.T)[:, :, None] * plane)


def _cross(one: Float64, other: Float64) -> Float64:
    """The cross product of two vectors (3,); NumPy's takes ten times as long for so few numbers."""
    (a, b, c), (d, e, f) = one, other
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])
