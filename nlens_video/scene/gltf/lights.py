"""Punctual lights (KHR_lights_punctual), in glTF's units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields

Kind = Literal["directional", "point", "spot"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
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
    range: float | None
    inner_cone: float
    outer_cone: float


@dataclass(frozen=True, slots=True, eq=False)
class PosedLight:
    """A light at one moment.

    Attributes:
        light: its properties.
        position: in the world (3,) [scene unit].
        direction: unit vector (3,) along which it shines.
    """

    light: Light
    position: Float64
    direction: Float64


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
    kind = item.text("type")
    spot = item.child("spot")
    outer = min(spot.number("outerConeAngle", math.pi / 4.0), math.pi / 2.0)
    reach = item.number("range") if "range" in item else None
    if reach is not None and reach <= 0.0:
        raise item.wrong("range", "a number above 0")
    return Light(
        kind=_kind(kind, item),
        color=item.vector("color", 3, (1.0, 1.0, 1.0)),
        intensity=item.number("intensity", 1.0),
        range=reach,
        inner_cone=max(0.0, min(spot.number("innerConeAngle", 0.0), outer)),
        outer_cone=outer,
    )


def _kind(kind: str, item: Fields) -> Kind:
    match kind:
        case "directional":
            return "directional"
        case "point":
            return "point"
        case "spot":
            return "spot"
        case _:
            raise item.wrong("type", "directional, point or spot")


def pose_light(light: Light, world: Float64) -> PosedLight:
    """A light on a node whose world matrix is (4, 4); it shines along the node's -Z.

    Raises:
        SceneError: the node has no extent, so there is no direction.
    """
    forward = -world[:3, 2]
    length = float(np.linalg.norm(forward))
    if length == 0.0:
        raise SceneError("a light's node is scaled to zero; give it a scale")
    return PosedLight(light, world[:3, 3].copy(), forward / length)
