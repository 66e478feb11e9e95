"""Pictures for the page: cheap looks at a frame's samples, and JPEGs that live in the text."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.video.pixels import blend
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.sample_tables import Axis, Samples
from nlens_video.video.pixels.sample_views import frame_samples

Image = npt.NDArray[np.uint8]
"""Display-coded sRGB (H, W, 3)."""

_WIDEST_PX = 1600
_THUMBNAIL_PX = 320
_QUALITY, _THUMBNAIL_QUALITY = 90, 82


def shown(rgb: Float32, widest_px: int = _WIDEST_PX) -> Image:
    """An sRGB picture (H, W, 3) in [0, 1] as 8 bit, reduced to at most `widest_px` columns."""
    height, width = rgb.shape[:2]
    if width > widest_px:
        size = (widest_px, max(1, round(height * widest_px / width)))
        rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.float32)
    return np.asarray(np.round(np.clip(rgb, 0.0, 1.0) * 255.0), np.uint8)


def copied(picture: Picture) -> Callable[[], Image]:
    """What the picture looks like now, converted only when it is called for.

    Copying samples costs a five-hundredth of converting them, and most plates are never looked at.
    """
    samples = _samples(picture)
    if samples is None:
        image = shown(picture.srgb())
        return lambda: image
    y, u, v = (plane.copy() for plane in samples.planes)
    still = replace(samples, planes=(y, u, v))
    return lambda: shown(_srgb(still))


def thumbnail(picture: Picture) -> bytes:
    """A small JPEG of the picture; converts no more pixels than it needs."""
    samples = _samples(picture)
    rgb = picture.srgb() if samples is None else _srgb(_reduced(samples))
    return jpeg(shown(rgb, _THUMBNAIL_PX), _THUMBNAIL_QUALITY)


def jpeg(image: Image, quality: int = _QUALITY) -> bytes:
    """The picture as a JPEG file."""
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    done, data = cv2.imencode(".jpg", image[..., ::-1], flags)
    if not done:
        raise ValueError(f"{image.shape = } cannot be written as a JPEG")
    return data.tobytes()


def data_uri(data: bytes) -> str:
    """A JPEG as the value of a `src` attribute."""
    return "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")


def _samples(picture: Picture) -> Samples | None:
    """Views of a decoded frame's samples, None for pictures of other kinds."""
    if not isinstance(picture, AvPicture):
        return None
    return frame_samples(picture.frame, picture.tags, round(picture.rotation / 90))


def _srgb(samples: Samples) -> Float32:
    height, width = samples.planes[0].shape
    return blend.srgb(samples, Box(0, 0, width, height))


def _reduced(samples: Samples) -> Samples:
    """The samples averaged down to the width of a thumbnail, each component to the same size.

    Averaged codes are not averaged light, but converting a few pixels instead of all
    keeps the report cheap, and nobody measures a thumbnail.
    """
    height, width = samples.planes[0].shape
    if width <= _THUMBNAIL_PX:
        return samples
    size = (_THUMBNAIL_PX, max(1, round(height * _THUMBNAIL_PX / width)))
    y, u, v = (
        cv2.resize(np.ascontiguousarray(plane), size, interpolation=cv2.INTER_AREA)
        for plane in samples.planes
    )
    return replace(samples, planes=(y, u, v), alpha=None, across=Axis(), down=Axis())
