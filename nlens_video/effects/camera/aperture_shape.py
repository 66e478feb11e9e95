"""The aperture's shape, read off the discs of highlights that are out of focus.

The discs' outlines, in radii of the disc of their area, are compared with those of apertures:
round, or of five to nine blades at any rotation and roundness, cut by the barrel towards the
corners of the frame (cat's eye). All discs of a plate are of one aperture, so the outlines are
fitted together, and a shape that only some of them show is none.

Highlights are taken to lie behind the focus; before it, an odd number of blades is turned by half a
turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Float64, Picture
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.effects.camera.highlight_discs import (
    ANGLES,
    DIRECTIONS,
    Discs,
    about_middle,
    find_discs,
)
from nlens_video.kernels.scatter.shape import boundary, outer_radius
from nlens_video.stages.f_coc import LUMA

FEWEST_DISCS = 4
_WIDEST_PX = 1920
_MOST_OFF = 0.08  # rms between the fitted outline and one that counts [radius]
_BLADES = range(5, 10)
_BETTER = 0.6  # squared error with blades by that of a round aperture
_CLEARLY = 0.85  # squared error of the best number of blades by that of the second best
_LEAST_CAT_EYE = 0.1


class ApertureReading(Struct, frozen=True):
    """An aperture as it shows on a plate.

    Attributes:
        aperture: its shape; round where nothing else is certain.
        discs: how many highlights tell it [1].
    """

    aperture: Aperture
    discs: int

    def __str__(self) -> str:
        """Its shape in words, with the option that gives it."""
        shape, option = "round", "round"
        if self.aperture.blades:
            option = (
                f"{self.aperture.blades}:{self.aperture.rotation_deg:.0f}"
                f":{self.aperture.roundness:.1f}"
            )
            shape = f"of {self.aperture.blades} blades"
        cut = f" --cat-eye {self.aperture.cat_eye:.1f}" if self.aperture.cat_eye else ""
        return f"{shape}, off {self.discs} highlights (--aperture {option}{cut})"


def read_aperture(picture: Picture, pixel_aspect: float = 1.0) -> ApertureReading | None:
    """The aperture's shape off a picture's highlights, None where too few of them are discs.

    Args:
        picture: the plate.
        pixel_aspect: width of a pixel by its height [1].
    """
    luma = np.asarray(picture.srgb() @ LUMA, np.float32)
    height, width = luma.shape
    scale = min(1.0, _WIDEST_PX / (width * pixel_aspect))
    size = (max(1, round(width * pixel_aspect * scale)), max(1, round(height * scale)))
    if size != (width, height):
        luma = np.asarray(cv2.resize(luma, size, interpolation=cv2.INTER_AREA), np.float32)
    return fit_aperture(find_discs(luma))


def _outlines_of(apertures: Sequence[Aperture], middles: Float64) -> Float64:
    """Outlines (A, N, 96) of apertures' discs at places in the frame, as of `Discs`."""
    uncut = np.stack([boundary(one, ANGLES) for one in apertures])[:, None]
    outlines = np.repeat(uncut, len(middles), axis=1)
    cat_eyes = np.array([one.cat_eye for one in apertures])
    cut = cat_eyes > 0.0
    if cut.any():
        rims = np.array([outer_radius(one) for one in apertures])[cut, None, None]
        # as `barrel_centre`, which takes pixels
        barrel = -cat_eyes[cut, None, None] * middles
        towards = barrel @ DIRECTIONS
        far = np.maximum(towards**2 - (barrel**2).sum(axis=-1, keepdims=True) + rims**2, 0.0)
        distance = np.minimum(uncut[cut], towards + np.sqrt(far))
        outlines[cut] = about_middle(distance[..., None] * DIRECTIONS.T)
    return outlines


def fit_aperture(discs: Discs) -> ApertureReading | None:
    """The aperture whose discs they are, None where fewer than `FEWEST_DISCS` are of one."""
    if len(discs.radii_px) < FEWEST_DISCS:
        return None
    barrel = _fit_cat_eye(ROUND, discs)
    bladed = [_fit_cat_eye(_fit_blades(count, barrel, discs), discs) for count in _BLADES]
    *errors, whole = _error([*bladed, barrel], discs)
    first, second = sorted(errors)[:2]
    clear = first < min(_BETTER * whole, _CLEARLY * second)
    found = bladed[errors.index(first)] if clear else barrel
    uncut = replace(found, cat_eye=0.0)
    cut_error, uncut_error = _error([found, uncut], discs)
    if found.cat_eye < _LEAST_CAT_EYE or cut_error > _BETTER * uncut_error:
        found = uncut
    of_one = int((_errors([found], discs) < _MOST_OFF**2).sum())
    if of_one < max(FEWEST_DISCS, 0.5 * len(discs.radii_px)):
        return None
    return ApertureReading(found, of_one)


def _fit_cat_eye(shape: Aperture, discs: Discs) -> Aperture:
    """The aperture of that shape whose cat's eye fits best."""
    coarse = _best(discs, [shape, *(replace(shape, cat_eye=0.2 * step) for step in range(6))])
    near = (coarse.cat_eye + 0.05 * step for step in (-2, -1, 1, 2))
    finer = (replace(shape, cat_eye=c) for c in near if 0.0 <= c <= 1.0)
    return _best(discs, [coarse, *finer])


def _fit_blades(count: int, whole: Aperture, discs: Discs) -> Aperture:
    """The aperture of so many blades that fits best."""
    period = 360.0 / count
    best = _best(discs, [
        whole,
        *(
            replace(whole, blades=count, rotation_deg=period * turn / 12, roundness=roundness)
            for turn in range(12)
            for roundness in (0.0, 0.3, 0.6, 0.8)
        ),
    ])  # fmt: skip
    for part in (0.5, 0.25, 0.125):
        turn, bulge = part * period / 6, 0.3 * part
        best = _best(discs, [best, *(
            replace(best, rotation_deg=best.rotation_deg + t * turn,
                    roundness=min(max(best.roundness + b * bulge, 0.0), 1.0))
            for t in (-1, 0, 1) for b in (-1, 0, 1)
        )])  # fmt: skip
    return replace(best, rotation_deg=best.rotation_deg % period)


def _best(discs: Discs, apertures: Sequence[Aperture]) -> Aperture:
    """The one of least error, the first of equal ones."""
    return apertures[int(np.argmin(_error(apertures, discs)))]


def _errors(apertures: Sequence[Aperture], discs: Discs) -> Float64:
    """Mean squared distance (A, N) between outlines and apertures' [radius**2]."""
    off = discs.outlines - _outlines_of(apertures, discs.middles)
    return np.asarray(np.mean(off**2, axis=-1))


def _error(apertures: Sequence[Aperture], discs: Discs) -> list[float]:
    """The same of all discs (A,), those that are none counted as `_MOST_OFF`."""
    error = np.minimum(_errors(apertures, discs), _MOST_OFF**2).mean(axis=1)
    return cast("list[float]", error.tolist())
