"""Materials: the file's metallic-roughness model and the extensions that change what is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.images import Image, ImageReader

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
Rows = tuple[tuple[float, float, float], tuple[float, float, float]]
_IDENTITY: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class TextureUse:
    """A texture where a material uses it.

    Attributes:
        image: the picture with its sampler.
        uv_set: which set of texture coordinates, 0 or 1.
        transform: two rows that map (u, v, 1) to the picture (KHR_texture_transform).
        strength: normalTexture.scale or occlusionTexture.strength, 1 elsewhere.
    """

    image: Image
    uv_set: int = 0
    transform: Rows = _IDENTITY
    strength: float = 1.0


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
        f0: dielectric reflectance at normal incidence (RGB), from KHR_materials_ior and _specular.
        alpha_mode: OPAQUE, MASK or BLEND.
        alpha_cutoff: MASK keeps what is not below it.
        double_sided: whether back faces are drawn.
        unlit: whether base colour is the radiance itself (KHR_materials_unlit).
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
    base_color_texture: TextureUse | None = None
    metallic_roughness_texture: TextureUse | None = None
    normal_texture: TextureUse | None = None
    occlusion_texture: TextureUse | None = None
    emissive_texture: TextureUse | None = None


def read_materials(document: Document) -> tuple[Material, ...]:
    """All materials of the file; index -1 (appended last) is the default material.

    Raises:
        SceneError: a factor of the wrong kind, or an image that cannot be decoded.
    """
    images = ImageReader(document)
    declared = document.items("materials")
    return (*(_read_material(document, images, item) for item in declared), Material())


def _read_material(document: Document, images: ImageReader, item: Fields) -> Material:
    pbr = item.child("pbrMetallicRoughness")
    strength = item.extension("KHR_materials_emissive_strength")
    gain = strength.number("emissiveStrength", 1.0) if strength else 1.0
    specular, f0 = _dielectric(item)
    if item.extension("KHR_materials_pbrSpecularGlossiness") is not None:
        document.warn("KHR_materials_pbrSpecularGlossiness is ignored; convert to metal-rough")

    def use(
        owner: Fields, key: str, strength_key: str = "", *, srgb: bool = False
    ) -> TextureUse | None:
        return _texture_use(document, images, owner, key, strength_key, srgb=srgb)

    return Material(
        name=item.name,
        base_color=pbr.vector("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0)),
        metallic=pbr.number("metallicFactor", 1.0),
        roughness=pbr.number("roughnessFactor", 1.0),
        emissive=tuple(gain * v for v in item.vector("emissiveFactor", 3, (0.0, 0.0, 0.0))),
        specular=specular,
        f0=f0,
        alpha_mode=_alpha_mode(item),
        alpha_cutoff=item.number("alphaCutoff", 0.5),
        double_sided=item.flag("doubleSided"),
        unlit=item.extension("KHR_materials_unlit") is not None,
        base_color_texture=use(pbr, "baseColorTexture", srgb=True),
        metallic_roughness_texture=use(pbr, "metallicRoughnessTexture"),
        normal_texture=use(item, "normalTexture", "scale"),
        occlusion_texture=use(item, "occlusionTexture", "strength"),
        emissive_texture=use(item, "emissiveTexture", srgb=True),
    )


def _alpha_mode(item: Fields) -> AlphaMode:
    match item.text("alphaMode", "OPAQUE"):
        case "OPAQUE":
            return "OPAQUE"
        case "MASK":
            return "MASK"
        case "BLEND":
            return "BLEND"
        case _:
            raise item.wrong("alphaMode", "OPAQUE, MASK or BLEND")


def _dielectric(item: Fields) -> tuple[float, tuple[float, ...]]:
    ior = item.extension("KHR_materials_ior")
    n = ior.number("ior", 1.5) if ior else 1.5
    # The extension's 0 stands for an infinite index: a mirror whose colour is specularColor.
    reflectance = 1.0 if n == 0.0 else ((n - 1.0) / (n + 1.0)) ** 2
    extension = item.extension("KHR_materials_specular")
    if extension is None:
        return 1.0, (reflectance,) * 3
    weight = extension.number("specularFactor", 1.0)
    color = extension.vector("specularColorFactor", 3, (1.0, 1.0, 1.0))
    return weight, tuple(weight * min(1.0, reflectance * c) for c in color)


def _texture_use(
    document: Document,
    images: ImageReader,
    owner: Fields,
    key: str,
    strength_key: str,
    *,
    srgb: bool,
) -> TextureUse | None:
    if key not in owner:
        return None
    info = owner.child(key)
    image = images.texture(info.integer("index", below=images.count), srgb=srgb)
    if image is None:
        return None
    transform = info.extension("KHR_texture_transform")
    uv_set = info.integer("texCoord", default=0)
    if transform is not None and "texCoord" in transform:
        uv_set = transform.integer("texCoord")
    if uv_set > 1:
        document.warn(f"{info.place} uses texture coordinates {uv_set}; only 0 and 1 are drawn")
        return None
    return TextureUse(
        image=image,
        uv_set=uv_set,
        transform=_transform_rows(transform) if transform else _IDENTITY,
        strength=info.number(strength_key, 1.0) if strength_key else 1.0,
    )


def _transform_rows(transform: Fields) -> Rows:
    """Translation * rotation * scale of KHR_texture_transform, as two rows."""
    du, dv = transform.vector("offset", 2, (0.0, 0.0))
    su, sv = transform.vector("scale", 2, (1.0, 1.0))
    angle = transform.number("rotation", 0.0)
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos * su, sin * sv, du), (-sin * su, cos * sv, dv)
