"""Bloom: exponential halos around clipped highlights, measured on the plate, added to the object.

The true radiance of a clipped highlight is unknown, so the strength of a halo is relative to white:
the share of the clipped light that its halo holds. A defocused highlight has a soft border that is
no halo: the border ends within twice its half-width, while a halo starts low and reaches far. Light
that a lamp casts on a wall around it cannot be distinguished from a halo.

The object's highlights count from white to twice white, where their halos match those of the
plate's clipped highlights. A halo that holds more light than white has is that of a far brighter
source, such as the sun, or the glow of the sky round it: it says nothing about such highlights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import BlurredLayer, Bool, Box, Float32, Float64, Picture
from nlens_video.core.optics import Bloom
from nlens_video.effects.measurement import Measurement

EFFECT = "bloom"
THRESHOLD_LEVELS = 4.0
LENGTHS_PX = tuple(float(length) for length in np.geomspace(3.0, 48.0, 13))
_WORK_WIDTH = 480
_CLIPPED = 0.92  # light from which on a picture counts as clipped [1]
_LEAST_AREA, _LARGEST_SHARE = 6, 0.1  # of a lamp: pixels of the work size; share of the picture
_REACH = 40  # radius around a lamp that is measured [px of the work size]
_SOFT_BORDER = 3.0  # borders end at so many times their half-width
_LEAST_CERTAINTY = 6.0
_LEAST_SECTORS = 8
_LEAST_CONTRAST = 1.0  # of the halo's deviation to that of everything else around
_MOST_SHARE = 1.0  # a halo with more light is of a source far beyond white, such as the sun
_BESIDE = (0.005, 0.01)  # the strip on which the halo's height is measured [width of the picture]
_MS_PER_MEGAPIXEL = 20.0
_LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on the first of a shot's pictures."""
    picture = pictures[0]
    step = max(1, math.ceil(picture.width / _WORK_WIDTH))
    light = picture.linear(Box(0, 0, picture.width, picture.height)) @ _LUMA
    height, width = (side // step * step for side in light.shape)
    size = (width // step, height // step)
    small = cv2.resize(light[:height, :width], size, interpolation=cv2.INTER_AREA)
    found = _halo(np.asarray(small, np.float32))
    model = None
    if found.certain:
        model = Bloom(share=found.share, length_px=found.length_px * step)
    return Measurement(
        effect=EFFECT,
        value=0.0 if model is None else found.levels,
        threshold=THRESHOLD_LEVELS,
        unit="8-bit levels beside highlights",
        evidence=found.words,
        model=model,
        cost_ms=_MS_PER_MEGAPIXEL * 0.2 * picture.width * picture.height / 1e6,
    )


Whole = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Halo:
    words: str
    share: float = 0.0
    length_px: float = 0.0
    levels: float = 0.0
    certain: bool = False


@dataclass(frozen=True, slots=True)
class _Surroundings:
    """Pixels around lamps (N,): light [1], number of the sector of a lamp, flat index."""

    light: Float64
    sector: Whole
    at: Whole


def _halo(light: Float32) -> _Halo:
    clipped = light >= _CLIPPED
    lamps = _lamps(clipped)
    if not lamps.any():
        return _Halo(words="nothing in the plate clips")
    around = _surroundings(light, clipped, lamps)
    count = len(np.unique(around.sector)) if around is not None else 0
    if around is None or count < _LEAST_SECTORS:
        return _Halo(words="what clips in the plate has nothing around that would show a halo")
    best: tuple[float, float, float, float, Float64] | None = None
    for length in LENGTHS_PX:
        halo = halo_of(clipped.astype(np.float32), length)
        spread = halo.ravel()[around.at].astype(np.float64)
        share, error, misfit, contrast = _fitted(around, spread)
        if best is None or misfit < best[0]:
            best = (misfit, share, error, contrast, spread)
            found_length = length
    assert best is not None
    _, share, error, contrast, spread = best
    certainty = share / error if error > 0 else 0.0
    levels = _levels_beside(light, lamps, share * halo_of(clipped.astype(np.float32), found_length))
    words = (
        f"light round what clips: {levels:.1f} levels of a halo that reaches "
        f"{found_length:.0f} px of {light.shape[1]} ({certainty:.0f} standard errors, "
        f"{count} sectors, {contrast:.1f} times as strong as what else is there)"
    )
    if share > _MOST_SHARE:
        words += "; more than white light has, as round the sun: the object has none such"
    return _Halo(
        words=words, share=share, length_px=found_length, levels=levels,
        certain=certainty >= _LEAST_CERTAINTY
        and contrast >= _LEAST_CONTRAST
        and share <= _MOST_SHARE
        and found_length < LENGTHS_PX[-1],
    )  # fmt: skip


def _lamps(clipped: Bool) -> Bool:
    """Clipped pixels, without specks and skies."""
    _, labels, figures, _ = cv2.connectedComponentsWithStats(clipped.astype(np.uint8))
    area = figures[:, cv2.CC_STAT_AREA]
    good = (area >= _LEAST_AREA) & (area <= _LARGEST_SHARE * clipped.size)
    good[0] = False
    return np.asarray(good[np.asarray(labels)])


def _surroundings(light: Float32, clipped: Bool, lamps: Bool) -> _Surroundings | None:
    """Pixels around lamps, beyond the soft border of each."""
    away, labels = cv2.distanceTransformWithLabels(
        (~lamps).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_CCOMP
    )
    others = cv2.dilate((clipped & ~lamps).astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    rows, columns = np.mgrid[: light.shape[0], : light.shape[1]]
    parts = []
    for number in range(1, int(np.max(labels)) + 1):
        own = (labels == number) & (away > 0) & (away <= _REACH) & ~others
        inside = (labels == number) & (away == 0)
        if own.sum() < 50 or not inside.any():
            continue
        start = _border(light[own], away[own])
        far = own & (away >= start)
        if start > 0.5 * _REACH or far.sum() < 50:
            continue
        turn = np.arctan2(rows[far] - rows[inside].mean(), columns[far] - columns[inside].mean())
        sector = number * 8 + np.floor((turn / np.pi + 1.0) * 4.0).astype(np.int64) % 8
        at = np.flatnonzero(far)
        parts.append((light[far], sector, at))
    if not parts:
        return None
    light_of, sector, at = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _Surroundings(light_of.astype(np.float64), sector, at)


def _border(light: Float32, away: Float32) -> float:
    """Distance at which the border of a lamp has certainly ended [px of the work size]."""
    ground = float(np.median(light[away > 0.6 * _REACH])) if (away > 0.6 * _REACH).any() else 0.0
    for distance in range(1, _REACH):
        ring = light[(away >= distance - 0.5) & (away < distance + 0.5)]
        if ring.size and float(np.quantile(ring, 0.7)) < ground + 0.5 * (1.0 - ground):
            return 2.0 + _SOFT_BORDER * (float(distance) - 0.5)
    return float(_REACH)


def _fitted(around: _Surroundings, spread: Float64) -> tuple[float, float, float, float]:
    """Share, standard error, misfit, contrast; each sector has its own background."""
    _, numbers = np.unique(around.sector, return_inverse=True)
    weights = np.ones(len(spread))
    share = 0.0
    for _ in range(8):
        light, halo = (_without_mean(part, numbers, weights) for part in (around.light, spread))
        told = float((weights * halo * halo).sum())
        share = float((weights * halo * light).sum()) / max(told, 1e-12)
        off = light - share * halo
        scale = 1.4826 * float(np.median(np.abs(off))) + 1e-6
        weights = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2) ** 2
    sums = np.bincount(numbers, weights * halo * off)
    error = float(np.sqrt((sums**2).sum())) / max(told, 1e-12)
    misfit = float(np.log1p((off / scale) ** 2).mean() + 2.0 * math.log(scale))
    return share, error, misfit, share * float(halo.std()) / scale


def _levels_beside(light: Float32, lamps: Bool, halo: Float32) -> float:
    """Mean of a halo in a strip around the lamps [8-bit levels]."""
    away = cv2.distanceTransform((~lamps).astype(np.uint8), cv2.DIST_L2, 5)
    near, far = (share * light.shape[1] for share in _BESIDE)
    strip = (away >= near) & (away < far)
    seen = light[strip].astype(np.float64)
    without = np.maximum(seen - halo[strip], 0.0)
    return 255.0 * float((_code(seen) - _code(without)).mean()) if strip.any() else 0.0


def _without_mean(values: Float64, numbers: Whole, weights: Float64) -> Float64:
    mean = np.bincount(numbers, weights * values) / np.bincount(numbers, weights)
    return np.asarray(values - mean[numbers])


def _code(light: Float64) -> Float64:
    return np.asarray(np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))


WHITE = 1.0
_REACH_LENGTHS = 6.0  # where the density has fallen to a four hundredth
_MARGIN_LIMIT_PX = 256
_COARSE_LENGTH = 4.0  # decay length on the grid of the quick halo [px]


def add_bloom(layer: BlurredLayer, bloom: Bloom, frame: Box) -> BlurredLayer:
    """A layer with the halos of its highlights; itself where nothing of it is above white.

    Args:
        layer: premultiplied, inside the frame.
        bloom: of the lens.
        frame: the frame's own box, which bounds the halos.
    """
    if layer.box.empty or float(layer.rgba[..., :3].max()) <= WHITE:
        return layer
    margin = math.ceil(min(_REACH_LENGTHS * bloom.length_px, _MARGIN_LIMIT_PX))
    wide = layer.box.expanded(margin)
    box = wide.intersection(frame)
    excess = np.clip(layer.rgba[..., :3] - np.float32(WHITE), 0.0, np.float32(WHITE))
    around = np.pad(excess, ((margin, margin), (margin, margin), (0, 0)))
    halo = quick_halo(around, bloom.length_px)[box.slices_in(wide)]
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    rgba[layer.box.slices_in(box)] = layer.rgba
    rgba[..., :3] += np.float32(bloom.share) * halo
    return BlurredLayer(box=box, rgba=rgba)


def halo_of(light: Float32, length_px: float) -> Float32:
    """Light (h, w) or (h, w, C) convolved with an exponential of decay length `length_px` [px]."""
    reach = math.ceil(7.0 * length_px)
    away = np.hypot(*np.meshgrid(*2 * [np.arange(-reach, reach + 1, dtype=np.float32)]))
    kernel = np.exp(-away / np.float32(length_px))
    border = cv2.BORDER_CONSTANT
    return np.asarray(cv2.filter2D(light, cv2.CV_32F, kernel / kernel.sum(), borderType=border))


def quick_halo(light: Float32, length_px: float) -> Float32:
    """`halo_of` on a grid as coarse as the halo allows."""
    step = max(1, int(length_px / _COARSE_LENGTH))
    if step == 1:
        return halo_of(light, length_px)
    height, width = light.shape[:2]
    padded = np.pad(light, ((0, -height % step), (0, -width % step), (0, 0)))
    rows, columns = padded.shape[0] // step, padded.shape[1] // step
    small = cv2.resize(padded, (columns, rows), interpolation=cv2.INTER_AREA)
    halo = halo_of(np.asarray(small, np.float32), length_px / step)
    size = (columns * step, rows * step)
    return np.asarray(cv2.resize(halo, size, interpolation=cv2.INTER_CUBIC)[:height, :width])
