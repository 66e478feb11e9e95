"""The levels of a texture, for both renderers: its picture and smaller ones.

Texels are 16-bit linear light, which represents 8-bit sRGB codes to within 1/130000; textures are
thus decoded once, before they are averaged.

Where alpha tells what is seen, colours are averaged by their alpha, and texels of alpha 0, whose
colours nobody chose, get the colours around them: a filter mixes them in at every edge. A texture
that cuts keeps on each level the share of texels at or above its cutoff (after Castano, "Computing
Alpha Mipmaps", 2010); plain averages fall below it, and far leaves would vanish.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.color import transfer
from nlens_video.scene.gltf.textures import LINEAR, NEAREST, Image

Texels = npt.NDArray[np.uint16]
_ONE = 65535


def mipmaps(image: Image) -> list[Texels]:
    """RGBA (h, w, 4) of the picture and, where its sampler wants them, of its halves."""
    picture = _decoded(image)
    levels = [picture]
    if image.min_filter in (NEAREST, LINEAR):
        return levels
    cutoff = image.cutoff
    if cutoff is None or picture[..., 3].min() == _ONE:
        _append_halves(levels)
        return levels
    levels = [_scaled(picture)]
    _append_halves(levels)
    levels = [picture, *(_unscaled(level) for level in levels[1:])]
    _fill_holes(levels)
    if cutoff > 0.0:
        _keep_coverage(levels, cutoff * _ONE)
    return levels


def _decoded(image: Image) -> Texels:
    codes = np.arange(256) / 255.0
    straight = np.round(codes * _ONE).astype(np.uint16)
    linear = transfer("iec61966-2-1").to_linear(codes)
    decoded = np.round(linear * _ONE).astype(np.uint16) if image.srgb else straight
    level: Texels = np.empty(image.pixels.shape, np.uint16)
    level[..., :3] = decoded[image.pixels[..., :3]]
    level[..., 3] = straight[image.pixels[..., 3]]
    return level


def _append_halves(levels: list[Texels]) -> None:
    level = levels[-1]
    while max(level.shape[:2]) > 1:
        height, width = max(1, level.shape[0] // 2), max(1, level.shape[1] // 2)
        half = cv2.resize(level, (width, height), interpolation=cv2.INTER_AREA)
        level = np.asarray(half, np.uint16).reshape(height, width, 4)
        levels.append(level)


def _scaled(level: Texels) -> Texels:
    """Colours times their alpha."""
    out = level.copy()
    for channel in range(3):
        out[..., channel] = cv2.multiply(level[..., channel], level[..., 3], scale=1.0 / _ONE)
    return out


def _unscaled(level: Texels) -> Texels:
    """Colours by their alpha, 0 where it is 0."""
    out = level.copy()
    for channel in range(3):
        out[..., channel] = cv2.divide(level[..., channel], level[..., 3], scale=_ONE)
    return out


def _fill_holes(levels: list[Texels]) -> None:
    """Give texels of alpha 0 the colours of the next smaller level, from the last level on."""
    for level, smaller in zip(levels[-2::-1], levels[:0:-1], strict=True):
        holes = level[..., 3] == 0
        if holes.any():
            height, width = holes.shape
            around = cv2.resize(smaller, (width, height), interpolation=cv2.INTER_LINEAR)
            level[holes, :3] = around.reshape(height, width, 4)[holes, :3]


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
        mixed = [
            np.asarray(cv2.addWeighted(between[1], 0.5, other, 0.5, 0.0), np.uint16)
            for other in between
        ]
        level[..., 3] = _bent(_reached(mixed, share), min(cutoff, _ONE))[level[..., 3]]


def _reached(fields: list[Texels], share: float) -> float:
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
