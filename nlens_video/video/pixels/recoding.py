"""Samples in other codes: of another matrix, range, depth or subsampling, exact to rounding."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from msgspec.structs import replace

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.thread_pool import Band, bands, parallel_for
from nlens_video.video.pixels.chroma import with_chroma, with_full_chroma
from nlens_video.video.pixels.samples import Coding, Plane, Samples

_BAND_ROWS = 128
"""Rows that fit into a processor's cache; a multiple of the steps of all subsamplings."""
_MARGIN = 8
"""Rows above and below a band from which its chroma is interpolated and filtered; so too."""
_NOTHING = 1e-9
"""Factors between codes that are rounding errors of the matrices; others are over 1e-7."""


def recode(source: Samples, target: Samples) -> None:
    """Write a picture into the samples of another one, rounded to the nearest of its codes.

    Transfer function and primaries stay. Colours beyond those that the target holds are clipped,
    those of floats in RGB, before any matrix; a missing alpha is opaque.

    Args:
        source: the picture; neither it nor the target is mirrored or turned.
        target: of the same size, in other memory.
    """
    height = target.planes[0].shape[0]
    margin = 0 if source.down.step == target.down.step == 1 else _MARGIN

    def write(band: Band) -> None:
        first, last = max(band[0] - margin, 0), min(band[1] + margin, height)
        mapped = _mapped(_rows(source, first, last), target.coding)
        made = with_chroma(mapped, target.across, target.down)
        _put(_rows(made, band[0] - first, band[1] - first), _rows(target, *band))

    parallel_for(write, bands(height, _BAND_ROWS))


def _rows(samples: Samples, first: int, last: int) -> Samples:
    """Some rows of a picture, the first one also a first one of chroma."""
    step = samples.down.step
    luma, blue, red = samples.planes
    chroma = slice(first // step, -(-last // step))
    return replace(
        samples, planes=(luma[first:last], blue[chroma], red[chroma]),
        alpha=None if samples.alpha is None else samples.alpha[first:last],
    )  # fmt: skip


def _mapped(source: Samples, coding: Coding) -> Samples:
    """The picture in other codes of float32, not rounded.

    Chroma that does not depend on luma stays at its pixels.
    """
    change = _change(source.coding, coding)
    first, second, third = (_floats(plane, source.coding, coding) for plane in source.planes)
    alpha = None
    if source.alpha is not None:
        gain = (coding.peak or 1.0) / (source.coding.peak or 1.0)
        alpha = _floats(source.alpha, source.coding, coding) * np.float32(gain)
    source = replace(source, planes=(first, second, third), alpha=alpha, coding=coding)
    scale, offset = change[:, :3].diagonal(), change[:, 3]
    if not (change[:, :3] - np.diag(scale)).any():
        first, second, third = (
            plane * factor + shift
            for plane, factor, shift in zip(source.planes, scale, offset, strict=True)
        )
        return replace(source, planes=(first, second, third))
    full = with_full_chroma(source)
    first, second, third = _mixed(full.planes, change)
    if change[1:, 0].any():
        return replace(full, planes=(first, second, third))
    second, third = _mixed(source.planes[1:], change[1:, 1:])
    return replace(source, planes=(first, second, third))


@lru_cache(maxsize=64)
def _change(source: Coding, target: Coding) -> Float32:
    """Affine map (3, 4) from codes of one kind to those of another."""
    own, other = source.rgb_from_codes, target.rgb_from_codes
    to_rgb = np.concatenate([own[:, :3], own[:, 3:] - other[:, 3:]], axis=1)
    change: Float64 = target.codes_from_rgb @ to_rgb
    change[np.abs(change) < _NOTHING] = 0.0
    return np.asarray(change, np.float32)


def _mixed(planes: tuple[Plane, ...], change: Float32) -> tuple[Plane, ...]:
    pixels = cv2.merge(planes)
    return tuple(cv2.transform(pixels, row[None]) for row in change)


def _floats(plane: Plane, own: Coding, other: Coding) -> Float32:
    values = plane.astype(np.float32)
    if own.bits or not other.bits:
        return values
    np.nan_to_num(values, copy=False, nan=0.0, posinf=1.0, neginf=0.0)
    return np.asarray(np.clip(values, 0.0, 1.0, out=values))


def _put(values: Samples, target: Samples) -> None:
    """Write codes, rounded and clipped; of grey the first component alone."""
    coding = target.coding
    shown = 1 if coding.family == "gray" else 3
    pairs = [*zip(values.planes, target.planes, strict=True)][:shown]
    if target.alpha is not None:
        if values.alpha is None:
            target.alpha[...] = coding.peak or 1.0
        else:
            pairs.append((values.alpha, target.alpha))
    for codes, plane in pairs:
        if coding.bits:
            np.rint(codes, out=codes)
            np.clip(codes, 0.0, coding.peak, out=codes)
        plane[...] = codes
