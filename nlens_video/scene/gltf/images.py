"""Textures: decoded pictures and how they are sampled."""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import PIL.Image

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields

# Pillow reads many more; some of them run other programs.
_FORMATS = ("PNG", "JPEG", "WEBP")
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


@dataclass(slots=True)
class ImageReader:
    """Decodes a document's textures, each picture once.

    Attributes:
        document: the file.
    """

    document: Document
    _pixels: dict[int, npt.NDArray[np.uint8]] = field(default_factory=dict)
    _textures: dict[tuple[int, bool], Image] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Textures in the file."""
        return len(self.document.items("textures"))

    def texture(self, index: int, *, srgb: bool) -> Image | None:
        """A texture, or None (with a warning) where its format has no fallback picture.

        Raises:
            SceneError: its picture is missing or cannot be decoded.
        """
        key = (index, srgb)
        if key not in self._textures:
            image = self._read(self.document.items("textures")[index], srgb=srgb)
            if image is None:
                return None
            self._textures[key] = image
        return self._textures[key]

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
            mag_filter=_code(sampler, "magFilter", (NEAREST, LINEAR), LINEAR),
            min_filter=_code(sampler, "minFilter", _MIN_FILTERS, _TRILINEAR),
            wrap=(
                _code(sampler, "wrapS", _WRAPS, _REPEAT),
                _code(sampler, "wrapT", _WRAPS, _REPEAT),
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
        except (
            OSError,
            ValueError,
            SyntaxError,
            PIL.Image.DecompressionBombError,
            PIL.Image.DecompressionBombWarning,
        ) as error:
            raise SceneError(
                f"{image.place} cannot be decoded ({error}); export it again"
            ) from error


def _rgba(picture: PIL.Image.Image) -> npt.NDArray[np.uint8]:
    if picture.mode.startswith("I"):  # 16-bit grey, which Pillow would clip, not scale
        grey = (np.asarray(picture).astype(np.float64) / 257.0).round().clip(0, 255)
        opaque = np.full_like(grey, 255.0)
        return np.stack([grey, grey, grey, opaque], axis=2).astype(np.uint8)
    return np.asarray(picture.convert("RGBA"))


def _code(sampler: Fields, key: str, allowed: tuple[int, ...], default: int) -> int:
    value = sampler.integer(key, default=default)
    if value not in allowed:
        raise sampler.wrong(key, f"one of {', '.join(map(str, allowed))}")
    return value
