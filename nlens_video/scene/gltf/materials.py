"""Materials: metallic-roughness factors, and the extensions that change what is drawn."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.color import transfer
from nlens_video.core.layers import Float64
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.textures import TextureReader, TextureUse

ALPHA_ROUNDING = 1e-4
"""By which cutoffs are lower than their files have them: alpha is filtered and interpolated."""
_BLACK, _OPAQUE = 1e-6, 80.0  # a colour that lets nothing through, and the depth of one
_VALUES = np.arange(256) / 255.0
_LIGHT = transfer("iec61966-2-1").to_linear(_VALUES)  # of colours
AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
_ALPHA_MODES: tuple[AlphaMode, ...] = ("OPAQUE", "MASK", "BLEND")


class Layers(Struct, frozen=True, kw_only=True):
    """What lies on or within a surface beyond metallic-roughness; linear light.

    Attributes:
        clearcoat: weight of a clear layer on top (KHR_materials_clearcoat), 0 to 1.
        clearcoat_roughness: of that layer, 0 to 1.
        sheen_color: of fibres on the surface (RGB; KHR_materials_sheen), black for none.
        sheen_roughness: of the fibres, 0 to 1.
        anisotropy: how far highlights are stretched (KHR_materials_anisotropy), 0 to 1.
        anisotropy_rotation: along which direction, against the clock from the tangent [rad].
        transmission: share of light that goes through instead of being scattered back
            (KHR_materials_transmission), 0 to 1.
        depth: what a volume takes from that light (RGB; KHR_materials_volume), as optical depth
            through its whole thickness, however large [1].
        bending: how much roughness blurs what is seen through it, 0 to 1, by the index of
            refraction.
    """

    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen_color: tuple[float, ...] = (0.0, 0.0, 0.0)
    sheen_roughness: float = 0.0
    anisotropy: float = 0.0
    anisotropy_rotation: float = 0.0
    transmission: float = 0.0
    depth: tuple[float, ...] = (0.0, 0.0, 0.0)
    bending: float = 1.0

    @property
    def absorption(self) -> tuple[float, ...]:
        """The optical depth (RGB), bounded where next to nothing comes through [1]."""
        return tuple(min(depth, _OPAQUE) for depth in self.depth)

    @property
    def drawn(self) -> tuple[str, ...]:
        """Those that can be seen, as shaders name them."""
        seen = {
            "CLEARCOAT": self.clearcoat > 0.0,
            "SHEEN": max(self.sheen_color) > 0.0,
            "ANISOTROPY": self.anisotropy > 0.0,
            "TRANSMISSION": self.transmission > 0.0,
        }
        return tuple(name for name, shown in seen.items() if shown)


class Material(Struct, frozen=True, kw_only=True, eq=False):
    """What a surface looks like; linear light throughout.

    Attributes:
        name: its name, possibly empty.
        base_color: factor of colour and alpha (RGBA).
        metallic: factor, 0 to 1.
        roughness: factor, 0 to 1.
        emissive: emitted radiance factor (RGB), strength included; may exceed 1.
        specular: dielectric specular weight (KHR_materials_specular), 0 to 1.
        f0: dielectric reflectance at normal incidence (RGB), from KHR_materials_ior times the
            colour of KHR_materials_specular, before its weight; may exceed 1.
        alpha_mode: OPAQUE, MASK or BLEND.
        alpha_cutoff: MASK keeps what is not below it.
        double_sided: whether back faces are drawn.
        unlit: whether base colour is the radiance itself (KHR_materials_unlit).
        layers: further layers; none of them where it is unlit.
    """

    name: str = ""
    base_color: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    metallic: float = 1.0
    roughness: float = 1.0
    emissive: tuple[float, ...] = (0.0, 0.0, 0.0)
    specular: float = 1.0
    f0: tuple[float, ...] = (0.04, 0.04, 0.04)
    alpha_mode: AlphaMode = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    unlit: bool = False
    layers: Layers = Layers()
    base_color_texture: TextureUse | None = None
    metallic_roughness_texture: TextureUse | None = None
    normal_texture: TextureUse | None = None
    occlusion_texture: TextureUse | None = None
    emissive_texture: TextureUse | None = None
    specular_texture: TextureUse | None = None
    specular_color_texture: TextureUse | None = None
    clearcoat_texture: TextureUse | None = None
    clearcoat_roughness_texture: TextureUse | None = None
    clearcoat_normal_texture: TextureUse | None = None
    sheen_color_texture: TextureUse | None = None
    sheen_roughness_texture: TextureUse | None = None
    anisotropy_texture: TextureUse | None = None
    transmission_texture: TextureUse | None = None
    thickness_texture: TextureUse | None = None

    def at_scale(self, scale: float) -> Material:
        """The same where its mesh is drawn at a scale [1].

        The thickness of a volume counts in the mesh's space, what it takes from light in the world.
        """
        depth = tuple(scale * depth for depth in self.layers.depth)
        return replace(self, layers=replace(self.layers, depth=depth))

    @property
    def see_through(self) -> bool:
        """Whether what lies behind it shows: it is drawn after all else, from far to near."""
        return self.alpha_mode == "BLEND" or self.layers.transmission > 0.0

    def mirrors(self, roughness: float) -> bool:
        """Whether any of it may be smoother than that, of what reflects or lets light through."""
        own = 0.0 if self.metallic_roughness_texture is not None else self.roughness
        layers = self.layers
        coated = layers.clearcoat > 0.0 or layers.transmission > 0.0
        return not self.unlit and (own < roughness or coated)

    @property
    def opacity(self) -> float:
        """Share of light that its shadow lacks, without the alpha of its texture."""
        return float(self.opacities(np.ones((1, 4)))[0])

    def opacities(self, colors: npt.ArrayLike) -> Float64:
        """The same (N,) where vertices have colours and alpha (N, 4)."""
        tints = np.asarray(colors, np.float64)
        alpha = np.ones(len(tints))
        if self.alpha_mode != "OPAQUE":
            alpha = self.base_color[3] * tints[:, 3]
        if self.alpha_mode == "MASK":
            return alpha
        passed = np.minimum((tints[:, :3] * self._clearness).mean(axis=1), 1.0)
        return np.asarray(alpha * (1.0 - passed))

    @property
    def _clearness(self) -> Float64:
        """Share of red, green and blue light that goes straight through, averaged over textures."""
        layers = self.layers
        if layers.transmission == 0.0:
            return np.zeros(3)
        metallic = self.metallic * _mean(self.metallic_roughness_texture, 2)
        share = layers.transmission * (1.0 - metallic) * (1.0 - self.specular * self.f0[1])
        share *= _mean(self.transmission_texture, 0)
        thickness, weights = np.ones(1), np.ones(1)
        if self.thickness_texture is not None:
            thickness, weights = _VALUES, self.thickness_texture.image.frequencies(1)
        passed = np.exp(-np.outer(thickness, layers.absorption))
        of_texture = [_mean(self.base_color_texture, channel, _LIGHT) for channel in range(3)]
        color = np.array(self.base_color[:3]) * of_texture
        return np.asarray(share * color * (weights @ passed))


def _mean(use: TextureUse | None, channel: int, values: Float64 = _VALUES) -> float:
    """Mean of a channel of a texture by what its 256 values stand for; 1 where there is none."""
    return 1.0 if use is None else float(use.image.frequencies(channel) @ values)


def read_materials(document: Document) -> tuple[Material, ...]:
    """All materials of the file; index -1 (appended last) is the default material.

    Raises:
        SceneError: a factor of the wrong kind, or an image that cannot be decoded.
    """
    textures = TextureReader(document)
    return (*(_read_material(textures, item) for item in document.items("materials")), Material())


def _read_material(textures: TextureReader, item: Fields) -> Material:
    pbr = item.child("pbrMetallicRoughness")
    strength = _extension(item, "KHR_materials_emissive_strength")
    gain = strength.not_negative("emissiveStrength", 1.0)
    specular = _extension(item, "KHR_materials_specular")
    color = specular.vector("specularColorFactor", 3, (1.0, 1.0, 1.0))
    n = _extension(item, "KHR_materials_ior").not_negative("ior", 1.5)
    coat = _extension(item, "KHR_materials_clearcoat")
    sheen = _extension(item, "KHR_materials_sheen")
    stretched = _extension(item, "KHR_materials_anisotropy")
    clear = _extension(item, "KHR_materials_transmission")
    volume = _extension(item, "KHR_materials_volume")
    unlit = item.extension("KHR_materials_unlit") is not None
    # The extension's 0 stands for an infinite index: a mirror whose colour is specularColor.
    reflectance = 1.0 if n == 0.0 else ((n - 1.0) / (n + 1.0)) ** 2
    base_color = pbr.vector("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0))
    alpha_mode = item.choice("alphaMode", _ALPHA_MODES, "OPAQUE")
    alpha_cutoff = max(0.0, item.number("alphaCutoff", 0.5) - ALPHA_ROUNDING)
    of_texture = _texture_cutoff(alpha_mode, alpha_cutoff, base_color[3])
    return Material(
        name=item.name,
        base_color=base_color,
        metallic=pbr.number("metallicFactor", 1.0),
        roughness=pbr.number("roughnessFactor", 1.0),
        emissive=tuple(gain * v for v in item.color("emissiveFactor", (0.0, 0.0, 0.0))),
        specular=specular.number("specularFactor", 1.0),
        f0=tuple(reflectance * c for c in color),
        alpha_mode=alpha_mode,
        alpha_cutoff=alpha_cutoff,
        double_sided=item.flag("doubleSided"),
        unlit=unlit,
        layers=Layers() if unlit else _read_layers(item, n),
        base_color_texture=textures.use(pbr, "baseColorTexture", srgb=True, cutoff=of_texture),
        metallic_roughness_texture=textures.use(pbr, "metallicRoughnessTexture"),
        normal_texture=textures.use(item, "normalTexture", "scale"),
        occlusion_texture=textures.use(item, "occlusionTexture", "strength"),
        emissive_texture=textures.use(item, "emissiveTexture", srgb=True),
        specular_texture=textures.use(specular, "specularTexture"),
        specular_color_texture=textures.use(specular, "specularColorTexture", srgb=True),
        clearcoat_texture=textures.use(coat, "clearcoatTexture"),
        clearcoat_roughness_texture=textures.use(coat, "clearcoatRoughnessTexture"),
        clearcoat_normal_texture=textures.use(coat, "clearcoatNormalTexture", "scale"),
        sheen_color_texture=textures.use(sheen, "sheenColorTexture", srgb=True),
        sheen_roughness_texture=textures.use(sheen, "sheenRoughnessTexture"),
        anisotropy_texture=textures.use(stretched, "anisotropyTexture"),
        transmission_texture=textures.use(clear, "transmissionTexture"),
        thickness_texture=textures.use(volume, "thicknessTexture"),
    )


def _texture_cutoff(mode: AlphaMode, cutoff: float, factor: float) -> float | None:
    """`Image.cutoff` of a base colour, by the alpha of its factor; that of vertices varies."""
    if mode == "BLEND":
        return 0.0
    return cutoff / factor if mode == "MASK" and cutoff > 0.0 and factor > 0.0 else None


def _read_layers(item: Fields, ior: float) -> Layers:
    coat = _extension(item, "KHR_materials_clearcoat")
    sheen = _extension(item, "KHR_materials_sheen")
    stretched = _extension(item, "KHR_materials_anisotropy")
    clear = _extension(item, "KHR_materials_transmission")
    return Layers(
        clearcoat=coat.number("clearcoatFactor", 0.0),
        clearcoat_roughness=coat.number("clearcoatRoughnessFactor", 0.0),
        sheen_color=sheen.vector("sheenColorFactor", 3, (0.0, 0.0, 0.0)),
        sheen_roughness=sheen.number("sheenRoughnessFactor", 0.0),
        anisotropy=stretched.number("anisotropyStrength", 0.0),
        anisotropy_rotation=stretched.number("anisotropyRotation", 0.0),
        transmission=min(max(clear.number("transmissionFactor", 0.0), 0.0), 1.0),
        depth=_optical_depth(_extension(item, "KHR_materials_volume")),
        # as the Khronos sample viewer has it: nothing is bent at 1, everything from 1.5 on
        bending=min(max(2.0 * ior - 2.0, 0.0), 1.0) if ior > 0.0 else 1.0,
    )


def _optical_depth(volume: Fields) -> tuple[float, ...]:
    """Optical depth of a volume's whole thickness (RGB), of a mesh at scale 1: Beer's law."""
    distance = volume.positive("attenuationDistance")
    color = volume.vector("attenuationColor", 3, (1.0, 1.0, 1.0))
    thickness = volume.number("thicknessFactor", 0.0)
    if distance is None or thickness <= 0.0:
        return 0.0, 0.0, 0.0
    share = thickness / distance
    return tuple(-math.log(min(max(c, _BLACK), 1.0)) * share for c in color)


def _extension(item: Fields, name: str) -> Fields:
    """An extension of a material; without members, hence with its defaults, where it has none."""
    return item.extension(name) or Fields({}, item.place)
