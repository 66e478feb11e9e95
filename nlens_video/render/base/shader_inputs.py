"""Lights and materials packed for the shaders, OpenGL's and the software rasteriser's."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Float32, Float64
from nlens_video.render.base.light_depth import LightDepth, no_light_depth
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.textures import TextureUse
from nlens_video.scene.illumination import MAX_LAMPS, Illumination, Lamp, PosedLight


class Lighting(Struct, frozen=True, eq=False):
    """The lights of one moment, directional ones first.

    Attributes:
        lights: of at most `MAX_LAMPS` lamps; a lamp whose map may take a part of its light is two,
            that part and the rest, which nothing blocks.
        ambient: light from around (9, 3), as of `Illumination.ambient`; None where there is none.
        surround: that light as of `Surround.levels`; None where no surface mirrors it.
        depth: of the object as some of the lights see it; None where nothing blocks them.
    """

    lights: tuple[PosedLight, ...]
    ambient: Float64 | None
    surround: Float32 | None = None
    depth: LightDepth | None = None

    @classmethod
    def of(
        cls,
        light: Illumination,
        *,
        mirrored: bool,
        depth: Callable[[Sequence[Lamp]], LightDepth | None] = no_light_depth,
    ) -> Lighting:
        """Pack an illumination.

        Args:
            light: on the object.
            mirrored: whether any surface is smooth.
            depth: gives the object's depth as lamps see it.
        """
        lamps = light.lamps[:MAX_LAMPS]
        ordered = sorted(lamps, key=lambda lamp: lamp.posed.light.kind != "directional")
        known = mirrored and light.ambient is not None and light.surround is not None
        surround = light.surround.levels if known and light.surround else None
        lights, mapped = _parted([lamp.posed for lamp in ordered], depth(ordered))
        return cls(lights, light.ambient, surround, mapped)

    @property
    def defines(self) -> dict[str, int]:
        """Preprocessor definitions of the shader."""
        counts = {
            "LAMP_COUNT": len(self.lights),
            "LAMP_ROWS": max(1, 4 * len(self.lights)),
            "DIRECTIONAL_COUNT": self.suns,
        }
        if self.ambient is not None:
            counts["USE_AMBIENT"] = 1
        if self.surround is not None:
            counts["USE_SURROUND"] = 1
        if self.depth is not None:
            counts["DEPTH_MAPS"] = len(self.depth.lights)
        return counts

    @property
    def suns(self) -> int:
        """How many of the lights are directional."""
        return sum(posed.light.kind == "directional" for posed in self.lights)

    def lamp_rows(self, eye: Float64) -> Float32:
        """Numbers of the lights (L, 16), relative to the eye (3,)."""
        maps = self.depth.lights if self.depth is not None else ()
        numbers = {light: number for number, light in enumerate(maps, start=1)}
        shown = self.surround is not None
        rows = [
            _lamp(one, eye, numbers.get(light, 0), in_surround=shown and one.in_surround)
            for light, one in enumerate(self.lights)
        ]
        return np.array(rows, dtype=np.float32).reshape(len(rows), 16)

    def ambient_rows(self) -> Float32:
        """Ambient light (9, 4), the fourth column 0."""
        rows = np.zeros((9, 4), np.float32)
        if self.ambient is not None:
            rows[:, :3] = self.ambient
        return rows

    def frame_block(self, clip_from_relative: Float64, eye: Float64) -> Float32:
        """Numbers of the frame: matrix (4, 4), eye (3,), ambient light, lights, their views.

        Args:
            clip_from_relative: clip space from world axes around the eye.
            eye: the camera's place in the world [scene unit].
        """
        lamps = self.lamp_rows(eye) if self.lights else np.zeros((1, 4))
        views = self.depth.rows(eye) if self.depth is not None else np.zeros(0)
        parts = [clip_from_relative, np.append(eye, 0.0), self.ambient_rows(), lamps, views]
        return np.concatenate([np.asarray(part, np.float32).ravel() for part in parts])


def _parted(
    lights: Sequence[PosedLight], depth: LightDepth | None
) -> tuple[tuple[PosedLight, ...], LightDepth | None]:
    """The lights as of `Lighting.lights`, and the depth with its lights' numbers among these."""
    if depth is None:
        return tuple(lights), None
    shares = dict(zip(depth.lights, depth.shares, strict=True))
    found, places = list[PosedLight](), dict[int, int]()
    for number, posed in enumerate(lights):
        share = shares.get(number, 1.0)
        places[number] = len(found)
        parts = (share, 1.0 - share) if share < 1.0 else ()
        found += [replace(posed, light=posed.light.scaled(part)) for part in parts] or [posed]
    return tuple(found), replace(depth, lights=tuple(places[number] for number in depth.lights))


def _lamp(
    posed: PosedLight, eye: Float64, depth_map: int, *, in_surround: bool
) -> list[tuple[float, ...]]:
    """Rows of a light; `depth_map` counts from 1, 0 for none."""
    light = posed.light
    strength = tuple(light.intensity * channel for channel in light.color)
    reach = 0.0 if light.range is None else light.range**-2.0
    scale, offset = 0.0, 1.0
    if light.kind == "spot":  # KHR_lights_punctual, "Inner and Outer Cone Angles"
        scale = 1.0 / max(1e-3, math.cos(light.inner_cone) - math.cos(light.outer_cone))
        offset = -scale * math.cos(light.outer_cone)
    return [
        (*strength, float(in_surround)),
        (*(posed.position - eye), reach),
        (*-posed.direction, 0.0),
        (scale, offset, float(depth_map), 0.0),
    ]


SLOTS = (
    "base_color",
    "metallic_roughness",
    "normal",
    "occlusion",
    "emissive",
    "specular",
    "specular_color",
    "clearcoat",
    "clearcoat_roughness",
    "clearcoat_normal",
    "sheen_color",
    "sheen_roughness",
    "anisotropy",
    "transmission",
    "thickness",
)
MATERIAL_FLOATS = 4 * (7 + 2 * len(SLOTS))


def texture_uses(material: Material) -> tuple[TextureUse | None, ...]:
    """The material's textures, in the order of `SLOTS`."""
    return tuple(getattr(material, f"{slot}_texture") for slot in SLOTS)


def material_params(material: Material) -> Float32:
    """Rows of four, flat (`MATERIAL_FLOATS`,).

    Base colour; metallic, roughness, specular weight, alpha cutoff; emission, transmission;
    dielectric reflectance, direction of anisotropy [rad]; weight and roughness of the clear coat,
    anisotropy, roughness of the sheen; its colour, uv set of tangents; absorption, bending; then
    for each slot (a, b, c, uv set) and (d, e, f, strength).
    """
    layers = material.layers
    rows = [
        material.base_color,
        (material.metallic, material.roughness, material.specular, material.alpha_cutoff),
        (*material.emissive, layers.transmission),
        (*_f0(material), layers.anisotropy_rotation),
        (
            layers.clearcoat,
            layers.clearcoat_roughness,
            layers.anisotropy,
            layers.sheen_roughness,
        ),
        (*layers.sheen_color, float(_tangents_of(material))),
        (*layers.absorption, layers.bending),
    ]
    for use in texture_uses(material):
        if use is None:
            rows += [(0.0,) * 4, (0.0,) * 4]
        else:
            rows += [
                (*use.transform[0], float(use.uv_set)),
                (*use.transform[1], use.strength),
            ]
    return np.array(rows, dtype=np.float32).ravel()


def _tangents_of(material: Material) -> int:
    """The set of texture coordinates along which tangents lie."""
    uses = (material.normal_texture, material.anisotropy_texture)
    return next((use.uv_set for use in uses if use is not None), 0)


def _f0(material: Material) -> tuple[float, ...]:
    """Dielectric reflectance, weighted and clamped unless shaders do it after a texture."""
    if material.specular_texture is not None or material.specular_color_texture is not None:
        return material.f0
    return tuple(material.specular * min(1.0, value) for value in material.f0)
