"""Materials: metallic-roughness factors, and the extensions that change what is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.textures import TextureReader, TextureUse

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
_ALPHA_MODES: tuple[AlphaMode, ...] = ("OPAQUE", "MASK", "BLEND")


@dataclass(frozen=True, slots=True, kw_only=True)
class Layers:
    """What lies on or within a surface beyond metallic-roughness; linear light.

    Attributes:
        clearcoat: weight of a clear layer on top (KHR_materials_clearcoat), 0 to 1.
        clearcoat_roughness: of that layer, 0 to 1.
        sheen_color: of fibres on the surface (RGB; KHR_materials_sheen), black for none.
        sheen_roughness: of the fibres, 0 to 1.
        anisotropy: how far highlights are stretched (KHR_materials_anisotropy), 0 to 1.
        anisotropy_rotation: along which direction, against the clock from the tangent [rad].
    """

    clearcoat: float = 0.0
    clearcoat_roughness: float = 0.0
    sheen_color: tuple[float, ...] = (0.0, 0.0, 0.0)
    sheen_roughness: float = 0.0
    anisotropy: float = 0.0
    anisotropy_rotation: float = 0.0

    @property
    def drawn(self) -> tuple[str, ...]:
        """Those that can be seen, as shaders name them."""
        seen = {
            "CLEARCOAT": self.clearcoat > 0.0,
            "SHEEN": max(self.sheen_color) > 0.0,
            "ANISOTROPY": self.anisotropy > 0.0,
        }
        return tuple(name for name, shown in seen.items() if shown)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Material:
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
    gain = strength.number("emissiveStrength", 1.0)
    specular = _extension(item, "KHR_materials_specular")
    color = specular.vector("specularColorFactor", 3, (1.0, 1.0, 1.0))
    n = _extension(item, "KHR_materials_ior").number("ior", 1.5)
    coat = _extension(item, "KHR_materials_clearcoat")
    sheen = _extension(item, "KHR_materials_sheen")
    stretched = _extension(item, "KHR_materials_anisotropy")
    unlit = item.extension("KHR_materials_unlit") is not None
    # The extension's 0 stands for an infinite index: a mirror whose colour is specularColor.
    reflectance = 1.0 if n == 0.0 else ((n - 1.0) / (n + 1.0)) ** 2
    return Material(
        name=item.name,
        base_color=pbr.vector("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0)),
        metallic=pbr.number("metallicFactor", 1.0),
        roughness=pbr.number("roughnessFactor", 1.0),
        emissive=tuple(gain * v for v in item.vector("emissiveFactor", 3, (0.0, 0.0, 0.0))),
        specular=specular.number("specularFactor", 1.0),
        f0=tuple(reflectance * c for c in color),
        alpha_mode=item.choice("alphaMode", _ALPHA_MODES, "OPAQUE"),
        alpha_cutoff=item.number("alphaCutoff", 0.5),
        double_sided=item.flag("doubleSided"),
        unlit=unlit,
        layers=Layers() if unlit else _read_layers(coat, sheen, stretched),
        base_color_texture=textures.use(pbr, "baseColorTexture", srgb=True),
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
    )


def _read_layers(coat: Fields, sheen: Fields, stretched: Fields) -> Layers:
    return Layers(
        clearcoat=coat.number("clearcoatFactor", 0.0),
        clearcoat_roughness=coat.number("clearcoatRoughnessFactor", 0.0),
        sheen_color=sheen.vector("sheenColorFactor", 3, (0.0, 0.0, 0.0)),
        sheen_roughness=sheen.number("sheenRoughnessFactor", 0.0),
        anisotropy=stretched.number("anisotropyStrength", 0.0),
        anisotropy_rotation=stretched.number("anisotropyRotation", 0.0),
    )


def _extension(item: Fields, name: str) -> Fields:
    """An extension of a material; without members, hence with its defaults, where it has none."""
    return item.extension(name) or Fields({}, item.place)
