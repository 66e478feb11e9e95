"""Materials: metallic-roughness factors, the extensions that change what is drawn, and textures."""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
import PIL.Image

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
_ALPHA_MODES: tuple[AlphaMode, ...] = ("OPAQUE", "MASK", "BLEND")
Rows = tuple[tuple[float, float, float], tuple[float, float, float]]
_IDENTITY: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
# Pillow reads many more; some of them run other programs.
_FORMATS = ("PNG", "JPEG", "WEBP")
_TOO_LARGE = (PIL.Image.DecompressionBombError, PIL.Image.DecompressionBombWarning)
NEAREST, LINEAR = 9728, 9729
_MIN_FILTERS = (9728, 9729, 9984, 9985, 9986, 9987)
_WRAPS = (33071, 33648, 10497)
_TRILINEAR, _REPEAT = 9987, 10497


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """A texture: its picture and sampler.

    Attributes:
        pixels: RGBA (H, W, 4), 8 bit, straight alpha, row 0 on top.
        srgb: whether RGB is sRGB-coded (colour) rather than linear (data).
        mag_filter: OpenGL's code of the filter for enlarging.
        min_filter: OpenGL's code of the filter for shrinking.
        wrap: OpenGL's codes of what lies beyond the edge, along u and v.
    """

    pixels: npt.NDArray[np.uint8]
    srgb: bool
    mag_filter: int = LINEAR
    min_filter: int = _TRILINEAR
    wrap: tuple[int, int] = (_REPEAT, _REPEAT)


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
    textures = TextureReader(document)
    return (*(_read_material(textures, item) for item in document.items("materials")), Material())


def _read_material(textures: TextureReader, item: Fields) -> Material:
    pbr = item.child("pbrMetallicRoughness")
    strength = item.extension("KHR_materials_emissive_strength")
    gain = strength.number("emissiveStrength", 1.0) if strength else 1.0
    specular, f0 = _dielectric(item)
    if item.extension("KHR_materials_pbrSpecularGlossiness") is not None:
        line = "KHR_materials_pbrSpecularGlossiness is ignored; convert to metal-rough"
        textures.document.warn(line)
    return Material(
        name=item.name,
        base_color=pbr.vector("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0)),
        metallic=pbr.number("metallicFactor", 1.0),
        roughness=pbr.number("roughnessFactor", 1.0),
        emissive=tuple(gain * v for v in item.vector("emissiveFactor", 3, (0.0, 0.0, 0.0))),
        specular=specular,
        f0=f0,
        alpha_mode=item.choice("alphaMode", _ALPHA_MODES, "OPAQUE"),
        alpha_cutoff=item.number("alphaCutoff", 0.5),
        double_sided=item.flag("doubleSided"),
        unlit=item.extension("KHR_materials_unlit") is not None,
        base_color_texture=textures.use(pbr, "baseColorTexture", srgb=True),
        metallic_roughness_texture=textures.use(pbr, "metallicRoughnessTexture"),
        normal_texture=textures.use(item, "normalTexture", "scale"),
        occlusion_texture=textures.use(item, "occlusionTexture", "strength"),
        emissive_texture=textures.use(item, "emissiveTexture", srgb=True),
    )


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


@dataclass(slots=True)
class TextureReader:
    """Decodes a document's textures, each picture once.

    Attributes:
        document: the file.
    """

    document: Document
    _pixels: dict[int, npt.NDArray[np.uint8]] = field(default_factory=dict)
    _textures: dict[tuple[int, bool], Image | None] = field(default_factory=dict)

    def use(
        self, owner: Fields, key: str, strength_key: str = "", *, srgb: bool = False
    ) -> TextureUse | None:
        """A material's texture, or None where it has none that can be drawn.

        Raises:
            SceneError: its picture is missing or cannot be decoded.
        """
        if key not in owner:
            return None
        info = owner.child(key)
        declared = self.document.items("textures")
        chosen = info.integer("index", below=len(declared)), srgb
        if chosen not in self._textures:
            self._textures[chosen] = self._read(declared[chosen[0]], srgb=srgb)
        image = self._textures[chosen]
        if image is None:
            return None
        transform = info.extension("KHR_texture_transform")
        uv_set = info.integer("texCoord", default=0)
        if transform is not None:
            uv_set = transform.integer("texCoord", default=uv_set)
        if uv_set > 1:
            self.document.warn(
                f"{info.place} uses texture coordinates {uv_set}; only 0 and 1 are drawn"
            )
            return None
        return TextureUse(
            image=image,
            uv_set=uv_set,
            transform=_transform_rows(transform) if transform else _IDENTITY,
            strength=info.number(strength_key, 1.0) if strength_key else 1.0,
        )

    def _read(self, texture: Fields, *, srgb: bool) -> Image | None:
        webp = texture.extension("EXT_texture_webp")
        owner = webp if webp is not None and "source" in webp else texture
        source = owner.reference("source", len(self.document.items("images")))
        if source is None:
            self.document.warn(f"{texture.place} has no PNG, JPEG or WebP picture; drawn without")
            return None
        if source not in self._pixels:
            self._pixels[source] = self._decode(self.document.items("images")[source])
        samplers = self.document.items("samplers")
        chosen = texture.reference("sampler", len(samplers))
        sampler = samplers[chosen] if chosen is not None else Fields({}, texture.place)
        return Image(
            pixels=self._pixels[source],
            srgb=srgb,
            mag_filter=sampler.choice("magFilter", (NEAREST, LINEAR), LINEAR),
            min_filter=sampler.choice("minFilter", _MIN_FILTERS, _TRILINEAR),
            wrap=(
                sampler.choice("wrapS", _WRAPS, _REPEAT),
                sampler.choice("wrapT", _WRAPS, _REPEAT),
            ),
        )

    def _decode(self, image: Fields) -> npt.NDArray[np.uint8]:
        views = len(self.document.items("bufferViews"))
        if "uri" in image:
            data = self.document.fetch(image.text("uri"), image.place)
        else:
            data = bytes(self.document.buffer_view(image.integer("bufferView", below=views)))
        try:
            with warnings.catch_warnings():
                # Pillow warns of pictures beyond 89 megapixels: here they are refused.
                warnings.simplefilter("error", PIL.Image.DecompressionBombWarning)
                with PIL.Image.open(io.BytesIO(data), formats=_FORMATS) as picture:
                    self.document.spend_texture(*picture.size, image.place)
                    return _rgba(picture)
        except (OSError, ValueError, SyntaxError, *_TOO_LARGE) as error:
            raise SceneError(
                f"{image.place} cannot be decoded ({error}); export it again"
            ) from error


def _rgba(picture: PIL.Image.Image) -> npt.NDArray[np.uint8]:
    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow would clip, not scale
        grey = (np.asarray(picture).astype(np.float64) / 257.0).round().clip(0, 255)
        opaque = np.full_like(grey, 255.0)
        return np.stack([grey, grey, grey, opaque], axis=2).astype(np.uint8)
    return np.asarray(picture.convert("RGBA"))


def _transform_rows(transform: Fields) -> Rows:
    """Translation * rotation * scale of KHR_texture_transform, as two rows."""
    du, dv = transform.vector("offset", 2, (0.0, 0.0))
    su, sv = transform.vector("scale", 2, (1.0, 1.0))
    angle = transform.number("rotation", 0.0)
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos * su, sin * sv, du), (-sin * su, cos * sv, dv)
