"""Bloom: exponential halos around highlights, measured on the plate, added to the object.

The true radiance of a clipped highlight is unknown, so the strength of a halo is relative to the
light at which it clips: white in SDR, more in HDR; in plates of light itself, to the highlight's
own. A defocused highlight has a soft border that is no halo: the border ends within twice its
half-width, while a halo starts low and reaches far. Light that a lamp casts on a wall around it
cannot be distinguished from a halo.

The object's highlights count from white to twice white, where their halos match those of the
plate's highlights; they count by their light, but as no brighter than where the plate clips. A halo
that holds more light than its highlight is that of a far brighter source, such as the sun, or the
glow of the sky round it: it says nothing about such highlights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import (
    BlurredLayer,
    Bool,
    Box,
    Float32,
    Float64,
    Int64,
    Picture,
    clips_at,
)
from nlens_video.core.optics import Bloom
from nlens_video.effects.camera.halo import halo_by_spectrum, quick_halo
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.plate_pictures import PlatePictures

EFFECT = "bloom"
THRESHOLD_LEVELS = 4.0
LENGTHS_PX = tuple(float(length) for length in np.geomspace(3.0, 48.0, 13))
_WORK_WIDTH = 480
_CLIPPED = 0.92  # light from which on something is a highlight: clipped, in SDR [1]
_LEAST_AREA, _LARGEST_SHARE = 6, 0.1  # of a lamp: pixels of the work size; share of the picture
_REACH = 40  # radius around a lamp that is measured [px of the work size]
_SOFT_BORDER = 3.0  # borders end at so many times their half-width
_LEAST_CERTAINTY = 6.0
_LEAST_SECTORS = 8
_LEAST_CONTRAST = 1.0  # of the halo's deviation to that of everything else around
_MOST_SHARE = 1.0  # a halo with more light is of a source far beyond white, such as the sun
_BESIDE = (0.005, 0.01)  # the strip on which the halo's height is measured [width of the picture]
_MS_PER_MEGAPIXEL = 20.0


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on the first of a shot's pictures."""
    picture = pictures[0]
    step = max(1, math.ceil(picture.width / _WORK_WIDTH))
    light = PlatePictures.of(pictures).light()
    height, width = (side // step * step for side in light.shape)
    size = (width // step, height // step)
    small = cv2.resize(light[:height, :width], size, interpolation=cv2.INTER_AREA)
    clip = clips_at(light, picture.peak)
    found = _halo(np.asarray(small, np.float32), clip)
    model = None
    if found.certain:
        model = Bloom(share=found.share, length_px=found.length_px * step, clip=clip)
    return Measurement(
        effect=EFFECT,
        value=0.0 if model is None else found.levels,
        threshold=THRESHOLD_LEVELS,
        unit="8-bit levels beside highlights",
        evidence=found.words,
        model=model,
        cost_ms=_MS_PER_MEGAPIXEL * 0.2 * picture.width * picture.height / 1e6,
    )


class _Halo(Struct, frozen=True, kw_only=True):
    words: str
    share: float = 0.0
    length_px: float = 0.0
    levels: float = 0.0
    certain: bool = False


class _Surroundings(Struct, frozen=True):
    """Pixels around lamps (N,), those of a sector of a lamp together.

    Attributes:
        light: of each [1].
        at: its flat index.
        starts: of the sectors (S,).
        counts: of their pixels (S,).
    """

    light: Float64
    at: Int64
    starts: Int64
    counts: Int64

    def by_sector(self, values: Float64) -> Float64:
        """Sums (S,) of values (N,)."""
        return np.asarray(np.add.reduceat(values, self.starts))

    def without_background(self, values: Float64, weights: Float64) -> Float64:
        """Values (N,) less their weighted mean in each sector."""
        mean = self.by_sector(weights * values) / self.by_sector(weights)
        return values - np.repeat(mean, self.counts)


def _halo(light: Float32, clip: float) -> _Halo:
    clipped = light >= _CLIPPED
    lamps = _lamps(clipped)
    if not lamps.any():
        return _Halo(words="nothing in the plate clips")
    sources = np.where(clipped, np.clip(light, 1.0, clip), 0.0).astype(np.float32)
    around = _surroundings(light, clipped, lamps, sources)
    count = len(around.starts) if around is not None else 0
    if around is None or count < _LEAST_SECTORS:
        return _Halo(words="what clips in the plate has nothing around that would show a halo")
    best: tuple[_Fit, float, Float32] | None = None
    for length in LENGTHS_PX:
        halo = halo_by_spectrum(sources, length)
        fit = _fitted(around, halo.ravel()[around.at].astype(np.float64))
        if best is None or fit.misfit < best[0].misfit:
            best = fit, length, halo
    assert best is not None
    fit, found_length, halo = best
    certainty = fit.share / fit.error if fit.error > 0 else 0.0
    levels = _levels_beside(light, lamps, fit.share * halo)
    words = (
        f"halo around clipped highlights: {levels:.1f} levels, reaching "
        f"{found_length:.0f} px of {light.shape[1]} ({certainty:.0f} times its error, "
        f"{count} sectors, {fit.contrast:.1f} times as strong as what else is there)"
    )
    if fit.share > _MOST_SHARE:
        words += "; more than a white highlight causes, as around the sun: the object gets none"
    return _Halo(
        words=words, share=fit.share, length_px=found_length, levels=levels,
        certain=certainty >= _LEAST_CERTAINTY
        and fit.contrast >= _LEAST_CONTRAST
        and fit.share <= _MOST_SHARE
        and found_length < LENGTHS_PX[-1],
    )  # fmt: skip


def _lamps(clipped: Bool) -> Bool:
    """Clipped pixels, without specks and skies."""
    _, labels, figures, _ = cv2.connectedComponentsWithStats(clipped.astype(np.uint8))
    area = figures[:, cv2.CC_STAT_AREA]
    good = (area >= _LEAST_AREA) & (area <= _LARGEST_SHARE * clipped.size)
    good[0] = False
    return np.asarray(good[np.asarray(labels)])


def _surroundings(
    light: Float32, clipped: Bool, lamps: Bool, sources: Float32
) -> _Surroundings | None:
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
        start = _border(light[own], away[own], float(np.median(sources[inside])))
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
    order = np.argsort(sector, kind="stable")
    _, starts, counts = np.unique(sector[order], return_index=True, return_counts=True)
    return _Surroundings(light_of[order].astype(np.float64), at[order], starts, counts)


def _border(light: Float32, away: Float32, lamp: float) -> float:
    """Distance at which the border of a lamp of this light has certainly ended [px of the size]."""
    ground = float(np.median(light[away > 0.6 * _REACH])) if (away > 0.6 * _REACH).any() else 0.0
    for distance in range(1, _REACH):
        ring = light[(away >= distance - 0.5) & (away < distance + 0.5)]
        if ring.size and float(np.quantile(ring, 0.7)) < ground + 0.5 * (lamp - ground):
            return 2.0 + _SOFT_BORDER * (float(distance) - 0.5)
    return float(_REACH)


class _Fit(Struct, frozen=True):
    """Share of the light in a halo of one length, its standard error, misfit, contrast."""

    share: float
    error: float
    misfit: float
    contrast: float


def _fitted(around: _Surroundings, spread: Float64) -> _Fit:
    """The share that fits best; each sector has its own background."""
    weights = np.ones(len(spread))
    share = 0.0
    for _ in range(8):
        light, halo = (around.without_background(part, weights) for part in (around.light, spread))
        told = float((weights * halo * halo).sum())
        share = float((weights * halo * light).sum()) / max(told, 1e-12)
        off = light - share * halo
        scale = 1.4826 * float(np.median(np.abs(off))) + 1e-6
        weights = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2) ** 2
    sums = around.by_sector(weights * halo * off)
    error = float(np.sqrt((sums**2).sum())) / max(told, 1e-12)
    misfit = float(np.log1p((off / scale) ** 2).mean() + 2.0 * math.log(scale))
    return _Fit(share, error, misfit, share * float(halo.std()) / scale)


def _levels_beside(light: Float32, lamps: Bool, halo: Float32) -> float:
    """Mean of a halo in a strip around the lamps [8-bit levels]."""
    away = cv2.distanceTransform((~lamps).astype(np.uint8), cv2.DIST_L2, 5)
    near, far = (share * light.shape[1] for share in _BESIDE)
    strip = (away >= near) & (away < far)
    seen = light[strip].astype(np.float64)
    without = np.maximum(seen - halo[strip], 0.0)
    return 255.0 * float((_code(seen) - _code(without)).mean()) if strip.any() else 0.0


def _code(light: Float64) -> Float64:
    return np.asarray(np.clip(light, 0.0, 1.0) ** (1.0 / 2.2))


WHITE = 1.0
_REACH_LENGTHS = 6.0  # where the density has fallen to a four hundredth
_MARGIN_LIMIT_PX = 256


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
    light = layer.rgba[..., :3]
    counted = np.clip(light - np.float32(WHITE), 0.0, np.float32(WHITE))
    counted *= np.minimum(light, np.float32(bloom.clip))
    around = np.pad(counted, ((margin, margin), (margin, margin), (0, 0)))
    halo = quick_halo(around, bloom.length_px, (wide.x0, wide.y0))[box.slices_in(wide)]
    rgba = np.zeros((box.height, box.width, 4), np.float32)
    rgba[layer.box.slices_in(box)] = layer.rgba
    if bloom.clip > WHITE:  # where a highlight's own light shows, what its halo holds is missing
        rgba[..., :3] -= np.float32(bloom.share) * around[box.slices_in(wide)]
    rgba[..., :3] += np.float32(bloom.share) * halo
    return BlurredLayer(box=box, rgba=rgba)
