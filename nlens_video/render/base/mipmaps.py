"""The levels of a texture, for both renderers: its picture and smaller ones.

Texels are 16-bit linear light, which represents 8-bit sRGB codes to within 1/130000; textures are
thus decoded once, before they are averaged.

Where alpha tells what is seen, colours are averaged by their alpha, and texels of alpha 0, whose
colours nobody chose, get the colours around them: a filter mixes them in at every edge. A texture
that cuts keeps on each level the share of texels at or above its cutoff (after Castano, "Computing
Alpha Mipmaps", 2010); plain averages fall below it, and far leaves would vanish.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.color import transfer
from nlens_video.scene.gltf.textures import LINEAR, NEAREST, Image

Texels = npt.NDArray[np.uint16]
_ONE = 65535
_OPAQUE = 255


def level_sizes(image: Image) -> list[tuple[int, int]]:
    """Rows and columns of the picture and, where its sampler wants them, of its halves."""
    height, width = image.picture.pixels.shape[:2]
    sizes = [(height, width)]
    while image.min_filter not in (NEAREST, LINEAR) and max(height, width) > 1:
        height, width = max(1, height // 2), max(1, width // 2)
        sizes.append((height, width))
    return sizes


def mipmaps(image: Image) -> list[Texels]:
    """RGBA (h, w, 4) of each level."""
    levels: list[Texels] = [np.empty((*size, 4), np.uint16) for size in level_sizes(image)]
    write_mipmaps(image, levels)
    return levels


def write_mipmaps(image: Image, levels: list[Texels]) -> None:
    """Write each level to its place (h, w, 4), whose rows may lie apart."""
    picture, *smaller = levels
    cv2.LUT(image.picture.pixels, _decoding(srgb=image.srgb), picture)
    cutoff = image.cutoff
    if cutoff is None or not smaller or image.picture.pixels[..., 3].min() == _OPAQUE:
        for larger, level in pairwise(levels):
            level[...] = _reduced(larger, level)
        return
    scaled = _scaled(picture)
    for level in smaller:
        scaled = _reduced(scaled, level)
        _unscale(scaled, level)
    _fill_holes(levels)
    if cutoff > 0.0:
        _keep_coverage(levels, cutoff * _ONE)


def _decoding(*, srgb: bool) -> Texels:
    """What the codes of each channel stand for (1, 256, 4)."""
    codes = np.arange(256) / 255.0
    light = transfer("iec61966-2-1").to_linear(codes) if srgb else codes
    decoded = np.stack([light, light, light, codes], axis=1)
    return np.round(decoded * _ONE).astype(np.uint16)[None]


def _reduced(larger: Texels, level: Texels) -> Texels:
    """Means of a level's texels for the next one."""
    height, width = level.shape[:2]
    half = cv2.resize(larger, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(half, np.uint16).reshape(level.shape)


def _scaled(level: Texels) -> Texels:
    """Colours times their alpha."""
    out = level.copy()
    for channel in range(3):
        out[..., channel] = cv2.multiply(level[..., channel], level[..., 3], scale=1.0 / _ONE)
    return out


def _unscale(scaled: Texels, level: Texels) -> None:
    """Write colours by their alpha, 0 where it is 0."""
    level[..., 3] = scaled[..., 3]
    for channel in range(3):
        level[..., channel] = cv2.divide(scaled[..., channel], scaled[..., 3], scale=_ONE)


def _fill_holes(levels: list[Texels]) -> None:
    """Give texels of alpha 0 the colours of the next smaller level, from the last level on."""
    for level, smaller in zip(levels[-2::-1], levels[:0:-1], strict=True):
        holes = level[..., 3] == 0
        if holes.any():
            height, width = holes.shape
            around = cv2.resize(smaller, (width, height), interpolation=cv2.INTER_LINEAR)
            around = around.reshape(height, width, 4)
            np.copyto(level[..., :3], around[..., :3], where=holes[..., None])


def _keep_coverage(levels: list[Texels], cutoff: float) -> None:
    """Bend the alpha of smaller levels so that the first one's share reaches a cutoff.

    Mixed texels reach it less often than texels, so the share is that of what is drawn: a level
    between its texels, alone and half way to those beside it.

    Args:
        levels: all but the first are changed.
        cutoff: in codes, above 0.
    """
    share = float((levels[0][..., 3] >= cutoff).mean())
    alphas = [np.ascontiguousarray(level[..., 3]) for level in levels]
    for number, level in enumerate(levels[1:], start=1):
        size = 2 * level.shape[1], 2 * level.shape[0]
        between = [
            np.asarray(cv2.resize(alpha, size, interpolation=cv2.INTER_LINEAR), np.uint16)
            for alpha in alphas[number - 1 : number + 2]
        ]
        mixed = (
            np.asarray(cv2.addWeighted(between[1], 0.5, other, 0.5, 0.0), np.uint16)
            for other in between
        )
        level[..., 3] = _bent(_reached(mixed, share), min(cutoff, _ONE))[level[..., 3]]


def _reached(fields: Iterable[Texels], share: float) -> float:
    """The code that a share of some fields (h, w) reaches, as far as can be from all of theirs."""
    counts = np.zeros(_ONE + 1)
    for field in fields:
        counts += cv2.calcHist([field], [0], None, [_ONE + 1], [0, _ONE + 1]).ravel()
    codes = np.flatnonzero(counts)
    above = 1.0 - np.cumsum(counts[codes]) / counts.sum()
    nearest = int(np.argmin(np.abs(np.concatenate([[1.0], above]) - share)))
    around = np.concatenate([[0], codes, [_ONE]])[nearest : nearest + 2]
    return float(np.clip(around.mean(), 1.0, _ONE - 1.0))


def _bent(edge: float, cutoff: float) -> Texels:
    """For each code another one: the cutoff for the edge; 0 and 1 stay what they are."""
    codes = np.arange(_ONE + 1)
    bent = codes * (cutoff / edge)
    if edge > cutoff:
        bent = np.interp(codes, [0.0, edge, _ONE], [0.0, cutoff, _ONE])
    return np.asarray(np.round(np.minimum(bent, _ONE)), np.uint16)
