"""Opacity of surfaces: alpha of their textures, and what their materials do with it."""

from __future__ import annotations

import numpy as np
from msgspec import Struct, field

from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.meshes import Geometry
from nlens_video.scene.gltf.textures import Image

MIRRORED, CLAMPED = 33648, 33071  # glTF's codes for texture wrapping
_OPAQUE = 254.5 / 255.0


class Opacity(Struct, frozen=True, eq=False):
    """Opacity of a surface.

    Attributes:
        alpha: of its texture (H, W), row 0 at v = 0; one texel of 1 where it has none [1].
        wrap: texture wrapping along u and v: 0 repeated, 1 mirrored, 2 clamped.
        cutoff: alpha from which on it is opaque, below which transparent; negative: alpha blending.
    """

    alpha: Float32
    wrap: tuple[int, int]
    cutoff: float

    @classmethod
    def of(cls, geometry: Geometry) -> Opacity | None:
        """Opacity of a geometry's surface; None where it is opaque."""
        material = geometry.material
        if material.alpha_mode == "OPAQUE" and not material.see_through:
            return None
        image = _image(material)
        alpha = np.ones((1, 1), np.float32)
        wrap = (0, 0)
        if image is not None:
            alpha = image.picture.pixels[..., 3].astype(np.float32) / np.float32(255.0)
            codes = {MIRRORED: 1, CLAMPED: 2}
            wrap = (codes.get(image.wrap[0], 0), codes.get(image.wrap[1], 0))
        cutoff = material.alpha_cutoff if material.alpha_mode == "MASK" else -1.0
        least = float(alpha.min()) * float(_factor(geometry, material).min(initial=1.0))
        if least >= (cutoff if cutoff >= 0.0 else _OPAQUE):
            return None
        return cls(np.ascontiguousarray(alpha), wrap, cutoff)


class Opacities(Struct, frozen=True, eq=False):
    """Opacity of surfaces, which does not change over time: each is read once.

    Those of one picture and cutoff are the same object.
    """

    _found: dict[Geometry, Opacity | None] = field(default_factory=dict)
    _alike: dict[tuple[Image | None, float], Opacity] = field(default_factory=dict)
    _texturing: dict[Geometry, Float32] = field(default_factory=dict)

    def of(self, geometry: Geometry) -> Opacity | None:
        """As `Opacity.of`."""
        if geometry not in self._found:
            found = Opacity.of(geometry)
            if found is not None:
                found = self._alike.setdefault((_image(geometry.material), found.cutoff), found)
            self._found[geometry] = found
        return self._found[geometry]

    def texturing(self, geometry: Geometry) -> Float32:
        """As the function of that name."""
        if geometry not in self._texturing:
            self._texturing[geometry] = texturing(geometry)
        return self._texturing[geometry]


def _image(material: Material) -> Image | None:
    """The picture whose alpha counts."""
    use = None if material.alpha_mode == "OPAQUE" else material.base_color_texture
    return None if use is None else use.image


def texturing(geometry: Geometry) -> Float32:
    """Texture coordinates in the picture of the opacity, and factor on its alpha (V, 3)."""
    use = geometry.material.base_color_texture
    uv = np.zeros((len(geometry.positions), 2), np.float32)
    if use is not None:
        own = geometry.uv[:, 2 * use.uv_set : 2 * use.uv_set + 2]
        rows = np.array(use.transform, np.float32)
        uv = own @ rows[:, :2].T + rows[:, 2]
    return np.column_stack([uv, _factor(geometry, geometry.material)])


def _factor(geometry: Geometry, material: Material) -> Float32:
    """Factor on the texture's alpha at each vertex (V,) [1]."""
    if geometry.colors is None:
        return np.full(len(geometry.positions), material.opacity, np.float32)
    return material.opacities(geometry.colors).astype(np.float32)
