"""Materials as the shaders read them, OpenGL's and our own."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.materials import Material, TextureUse

SLOTS = ("base_color", "metallic_roughness", "normal", "occlusion", "emissive")
MATERIAL_FLOATS = 4 * 14


def texture_uses(material: Material) -> tuple[TextureUse | None, ...]:
    """The material's textures, in the order of `SLOTS`."""
    return tuple(getattr(material, f"{slot}_texture") for slot in SLOTS)


def material_numbers(material: Material) -> Float32:
    """Rows of four, flat (`MATERIAL_FLOATS`,).

    Base colour; metallic, roughness, specular weight, alpha cutoff; emission; reflectance; then
    for each slot (a, b, c, uv set) and (d, e, f, strength).
    """
    rows = [
        material.base_color,
        (material.metallic, material.roughness, material.specular, material.alpha_cutoff),
        (*material.emissive, 0.0),
        (*material.f0, 0.0),
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
