"""Lights as the shader reads them, and those for a file that has none."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nlens_video.frames import Float32, Float64
from nlens_video.scene.lights import Light, PosedLight

MAX_LIGHTS = 32
_KEY = Light(
    kind="directional",
    color=(1.0, 0.97, 0.92),
    intensity=2.4,
    range=None,
    inner_cone=0.0,
    outer_cone=math.pi / 4.0,
)
_KEY_DIRECTION = np.array([-0.4, -0.8, -0.45]) / np.linalg.norm([-0.4, -0.8, -0.45])
_SKY, _GROUND = (0.32, 0.36, 0.42), (0.16, 0.14, 0.12)
_DEFAULT = PosedLight(_KEY, np.zeros(3), _KEY_DIRECTION)


@dataclass(frozen=True, slots=True)
class Lighting:
    """The lights of one moment, directional ones first.

    Attributes:
        lights: at most `MAX_LIGHTS`.
        ambient: whether a sky and a ground light the object too.
    """

    lights: tuple[PosedLight, ...]
    ambient: bool

    @classmethod
    def of(cls, lights: tuple[PosedLight, ...]) -> Lighting:
        """The file's lights, or a sky, a ground and a key light from above where it has none."""
        if not lights:
            return cls((_DEFAULT,), ambient=True)
        ordered = sorted(lights, key=lambda posed: posed.light.kind != "directional")
        return cls(tuple(ordered[:MAX_LIGHTS]), ambient=False)

    @property
    def defines(self) -> dict[str, int]:
        """What the shader is compiled for."""
        directional = sum(posed.light.kind == "directional" for posed in self.lights)
        counts = {
            "LAMP_COUNT": len(self.lights),
            "LAMP_ROWS": 4 * len(self.lights),
            "DIRECTIONAL_COUNT": directional,
        }
        return {**counts, "USE_AMBIENT": 1} if self.ambient else counts

    def frame_block(self, clip_from_relative: Float64, eye: Float64) -> Float32:
        """Numbers of the frame: matrix (4, 4), eye (3,), ambient light, lights relative to the eye.

        Args:
            clip_from_relative: clip space from world axes around the eye.
            eye: the camera's place in the world [scene unit].
        """
        rows = [*clip_from_relative, (*eye, 0.0)]
        rows += [(*_SKY, 0.0), (*_GROUND, 0.0)] if self.ambient else [(0.0,) * 4] * 2
        for posed in self.lights:
            rows += _lamp(posed, eye)
        return np.array(rows, dtype=np.float32).ravel()


def light_note(count: int) -> str:
    """What lights the object, in words, for a file with `count` lights."""
    if count == 0:
        return "the file has no lights: lit by a default sky and a key light from above"
    if count > MAX_LIGHTS:
        return f"the file has {count} lights: the first {MAX_LIGHTS} light the object"
    return f"lit by the file's {count} light{'s' if count > 1 else ''}"


def _lamp(posed: PosedLight, eye: Float64) -> list[tuple[float, ...]]:
    light = posed.light
    strength = tuple(light.intensity * channel for channel in light.color)
    reach = 0.0 if light.range is None else light.range**-2.0
    scale, offset = 0.0, 1.0
    if light.kind == "spot":  # KHR_lights_punctual, "Inner and Outer Cone Angles"
        scale = 1.0 / max(1e-3, math.cos(light.inner_cone) - math.cos(light.outer_cone))
        offset = -scale * math.cos(light.outer_cone)
    return [
        (*strength, 0.0),
        (*(posed.position - eye), reach),
        (*-posed.direction, 0.0),
        (scale, offset, 0.0, 0.0),
    ]
