"""Textures: decoded pictures, their samplers, and where on a surface they lie."""

from __future__ import annotations

import importlib.util
import io
import math
import mmap
import struct
import subprocess
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import PIL
import PIL.features
import PIL.Image
from msgspec import Struct

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.scene.gltf.decode_worker import decode
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields

Rows = tuple[tuple[float, float, float], tuple[float, float, float]]
_IDENTITY: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
# Pillow reads many more; some of them run other programs.
_FORMATS = ("PNG", "JPEG", "WEBP", *(("AVIF",) if PIL.features.check("avif") else ()))
_OTHER_FORMATS = ("EXT_texture_webp", "EXT_texture_avif")
_BASISU = "KHR_texture_basisu"
_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"
_KTX2_SIZE_AT, _KTX2_HEADER = 20, 80  # where its width and height are; of all that is fixed
_EXPAND_FIRST = "decode it first: gltf-transform ktxdecompress IN.glb OUT.glb"
_TOO_LARGE = (PIL.Image.DecompressionBombError, PIL.Image.DecompressionBombWarning)
NEAREST, LINEAR = 9728, 9729
_MIN_FILTERS = (9728, 9729, 9984, 9985, 9986, 9987)
_WRAPS = (33071, 33648, 10497)
_TRILINEAR, _REPEAT = 9987, 10497
_LOOKED_AT = 512  # texels of its longer side that tell what a picture is like on the whole
Pixels = npt.NDArray[np.uint8]
_Found = TypeVar("_Found")


@dataclass(slots=True, eq=False)
class Picture:
    """A picture, decoded when its pixels are first asked for.

    Attributes:
        decode: gives the pixels.
    """

    decode: Callable[[], Pixels]
    _pixels: Pixels | None = field(init=False, default=None)
    _sample: Pixels | None = field(init=False, default=None)

    @property
    def pixels(self) -> Pixels:
        """RGBA (H, W, 4), 8 bit, straight alpha, row 0 on top."""
        pixels = self._pixels
        if pixels is None:
            pixels = self._pixels = _in_own_memory(self.decode())
        return pixels

    @property
    def sample(self) -> Pixels:
        """The pixels of evenly spaced rows and columns (h, w, 4)."""
        if self._sample is None:
            pixels = self.pixels
            step = max(1, max(pixels.shape[:2]) // _LOOKED_AT)
            self._sample = pixels[::step, ::step].copy()
        return self._sample

    def release(self) -> None:
        """Free all pixels but the sample's; they are decoded again if still asked for."""
        _ = self.sample
        self._pixels = None


class Image(Struct, frozen=True, kw_only=True, eq=False):
    """A texture: its picture and sampler.

    Attributes:
        picture: what it shows.
        srgb: whether RGB is sRGB-coded (colour) rather than linear (data).
        mag_filter: OpenGL's code of the filter for enlarging.
        min_filter: OpenGL's code of the filter for shrinking.
        wrap: OpenGL's codes of what lies beyond the edge, along u and v.
        cutoff: alpha below which nothing of a texel is seen, 0 where alpha is how much of it is
            seen; None where alpha tells neither.
    """

    picture: Picture
    srgb: bool
    mag_filter: int = LINEAR
    min_filter: int = _TRILINEAR
    wrap: tuple[int, int] = (_REPEAT, _REPEAT)
    cutoff: float | None = None

    def frequencies(self, channel: int) -> Float64:
        """How frequent each of the 256 values of a channel is among its texels (256,); 1 in all."""
        values = self.picture.sample[..., channel]
        return np.bincount(values.ravel(), minlength=256) / values.size


class TextureUse(Struct, frozen=True, kw_only=True):
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


@dataclass(slots=True)
class TextureReader:
    """Decodes a document's textures, each picture once.

    Attributes:
        document: the file.
    """

    document: Document
    _pictures: dict[int, Picture] = field(default_factory=dict)
    _textures: dict[tuple[int, bool, float | None], Image | None] = field(default_factory=dict)

    def use(
        self,
        owner: Fields,
        key: str,
        strength_key: str = "",
        *,
        srgb: bool = False,
        cutoff: float | None = None,
    ) -> TextureUse | None:
        """A material's texture, or None where it has none that can be drawn.

        Args:
            owner: what has it.
            key: under which name.
            strength_key: of its strength there; none by default.
            srgb: as of `Image`.
            cutoff: likewise.

        Raises:
            SceneError: its picture is missing or cannot be decoded.
        """
        if key not in owner:
            return None
        info = owner.child(key)
        declared = self.document.items("textures")
        chosen = info.integer("index", below=len(declared)), srgb, cutoff
        if chosen not in self._textures:
            found = self._read(declared[chosen[0]], srgb=srgb, cutoff=cutoff)
            self._textures[chosen] = found
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

    def _read(self, texture: Fields, *, srgb: bool, cutoff: float | None) -> Image | None:
        others = (texture.extension(name) for name in _OTHER_FORMATS)
        owner = next((other for other in others if other and "source" in other), texture)
        if "source" not in owner:
            owner = texture.extension(_BASISU) or owner
        source = owner.reference("source", len(self.document.items("images")))
        if source is None:
            self.document.warn(
                f"{texture.place} has no PNG, JPEG, WebP, AVIF or KTX2 picture; drawn without"
            )
            return None
        if source not in self._pictures:
            self._pictures[source] = self._picture(self.document.items("images")[source])
        samplers = self.document.items("samplers")
        chosen = texture.reference("sampler", len(samplers))
        sampler = samplers[chosen] if chosen is not None else Fields({}, texture.place)
        enlarged = sampler.choice("magFilter", (NEAREST, LINEAR), LINEAR)
        shrunk = sampler.choice("minFilter", _MIN_FILTERS, _TRILINEAR)
        return Image(
            picture=self._pictures[source],
            srgb=srgb,
            mag_filter=enlarged,
            # Other filters only save time where texels are not meant to be seen: they flicker.
            min_filter=_TRILINEAR if enlarged == LINEAR else shrunk,
            wrap=(
                sampler.choice("wrapS", _WRAPS, _REPEAT),
                sampler.choice("wrapT", _WRAPS, _REPEAT),
            ),
            cutoff=cutoff,
        )

    def _picture(self, image: Fields) -> Picture:
        views = len(self.document.items("bufferViews"))
        if "uri" in image:
            data = self.document.fetch(image.text("uri"), image.place)
        else:
            data = bytes(self.document.buffer_view(image.integer("bufferView", below=views)))
        if data.startswith(_KTX2):
            width, height = _ktx2_size(data, image.place)
            picture = Picture(partial(_expanded, data, image.place))
        else:
            width, height = _opened(data, image, lambda opened: opened.size)
            picture = Picture(partial(_opened, data, image, _rgba))
        self.document.spend_texture(width, height, image.place)
        _ = picture.pixels  # what cannot be decoded is found before anything is drawn
        return picture


def _in_own_memory(pixels: Pixels) -> Pixels:
    """A copy that goes back to the system once it is freed, not to the heap."""
    memory = mmap.mmap(-1, max(1, pixels.nbytes))
    copy = np.frombuffer(memory, np.uint8, pixels.size).reshape(pixels.shape)
    copy[...] = pixels
    return copy


def _ktx2_size(data: bytes, place: str) -> tuple[int, int]:
    if importlib.util.find_spec("opengl_basisu") is None:
        raise SceneError(
            f"{place} is compressed ({_BASISU}) and the decoder is not installed: "
            f"pip install nlens-video[ktx2]; or {_EXPAND_FIRST}"
        )
    if len(data) < _KTX2_HEADER:
        raise SceneError(f"{place} is a KTX2 picture of {len(data)} bytes; export it again")
    width, height = struct.unpack_from("<II", data, _KTX2_SIZE_AT)
    return width, height


def _expanded(data: bytes, place: str) -> Pixels:
    """A KTX2 picture."""
    width, height = _ktx2_size(data, place)
    try:
        decoded = decode("ktx2", {"picture": np.frombuffer(data, np.uint8)})
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SceneError(f"{place} cannot be decoded ({error}); {_EXPAND_FIRST}") from error
    pixels = None if decoded is None else decoded["picture"]
    if pixels is None or pixels.shape != (height, width, 4):
        raise SceneError(f"{place} is a KTX2 picture that is broken; {_EXPAND_FIRST}")
    return pixels.astype(np.uint8)


def _opened(data: bytes, image: Fields, found: Callable[[PIL.Image.Image], _Found]) -> _Found:
    """What is found in a picture of the other formats."""
    try:
        with warnings.catch_warnings():
            # Pillow warns of pictures beyond 89 megapixels: here they are refused.
            warnings.simplefilter("error", PIL.Image.DecompressionBombWarning)
            with PIL.Image.open(io.BytesIO(data), formats=_FORMATS) as picture:
                return found(picture)
    except PIL.UnidentifiedImageError as error:
        kind = image.text("mimeType")[:40]
        stated = f" (its mimeType is {kind!r})" if kind else ""
        came = "is no PNG, JPEG, WebP, AVIF or KTX2 picture" if data else "is empty"
        raise SceneError(f"{image.place} {came}{stated}; export it again as PNG or JPEG") from error
    except (OSError, ValueError, SyntaxError, *_TOO_LARGE) as error:
        raise SceneError(f"{image.place} cannot be decoded ({error}); export it again") from error


def _rgba(picture: PIL.Image.Image) -> Pixels:
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
