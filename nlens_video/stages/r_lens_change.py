"""R over time: detects changes of the lens, tells them from the errors of two fits, follows them.

Estimating the CoC takes a tenth of a second, the change detector a few milliseconds. It compares
the plate's blur with that at the last fit: patches on a grid are split in octaves of detail. Blur
removes detail octave by octave, whatever the light and the contrast, so the ratio of neighbouring
octaves is compared: by rows of patches, since the depth of a ground, and so its blur, goes by rows;
and by medians, so that moving things do not count.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64, Picture
from nlens_video.core.lens_fit import IN_FOCUS_PX, LensFit

CHANGED = 0.1
"""Change of the log-ratio of two octaves that calls for another fit: a focus that moves by 7 %
gives as much, or an aperture that opens by a fifth; noise and a panning camera seldom do."""

SETTLED_CHANGE, SETTLED_S = 0.4 * CHANGED, 0.5
"""Change that calls for another fit as well, and how long after the last one [1, s]."""

SPACING_S = 0.12
"""Least time between two fits of one shot of a file [s]."""

AT_REST = 0.5 * CHANGED
"""A smaller change than this means that the lens has come to rest."""

CUT = 0.12  # mean change of the patches' brightness from one frame to the next [1]
_STILL = 0.03  # median change of it while the camera stands still [1]
_TOLD_STILL, _TOLD_MOVING = 2.0, 4.0
"""Standard errors by which the CoC must change. What the ground's texture does to a fit is the same
on all frames of a still camera, and not where the camera moves."""

_ROWS, _COLUMNS = 6, 8
_PATCH_SHARE = 1 / 16  # of the frame's width
_SMALLEST_PX, _LARGEST_PX = 24, 64
_BLURS_PX = (0.8, 1.6, 3.2, 6.4)  # between which the octaves lie
_FLOOR = 1.5e-3  # detail of less than this is noise (root of scene-linear light) [1]


class Signature(Struct, frozen=True):
    """Blur and light of a frame on a grid of patches.

    Attributes:
        ratios: log-ratios of neighbouring octaves (rows, columns, octaves - 1), nan where a patch
            has no detail.
        light: mean of each patch (rows, columns), root of scene-linear light [1].
    """

    ratios: Float64
    light: Float64


def signature(picture: Picture) -> Signature:
    """Signature of a frame."""
    side = int(min(max(_PATCH_SHARE * picture.width, _SMALLEST_PX), _LARGEST_PX))
    side = min(side, picture.width, picture.height)
    corners = [
        ((picture.width - side) * (2 * column + 1) // (2 * _COLUMNS),
         (picture.height - side) * (2 * row + 1) // (2 * _ROWS))
        for row in range(_ROWS) for column in range(_COLUMNS)
    ]  # fmt: skip
    root = np.sqrt(np.maximum(picture.green_patches(corners, side), np.float32(0.0)))
    grid = (_ROWS, _COLUMNS)
    return Signature(_octaves(root).reshape(*grid, -1), root.mean(axis=(1, 2)).reshape(grid))


def _octaves(patches: Float32) -> Float64:
    """Log-ratios of adjacent octaves (N, octaves - 1) of patches (N, side, side), nan in noise."""
    detail = octave_detail(patches)
    ratios = np.diff(np.log(np.maximum(detail, _FLOOR)).astype(np.float64), axis=1)
    ratios[detail[:, 1:] <= _FLOOR] = np.nan
    return np.asarray(ratios)


def octave_detail(patches: Float32) -> Float32:
    """Standard deviation (N, octaves) of the detail between two blurs of patches (N, side, side).

    A patch that is mirrored at its borders is a sum of cosines, and a Gaussian blur scales each of
    them by itself: the squares of their amplitudes give what blurring the patch would.
    """
    cosines, weights = _cosines(patches.shape[1])
    power = cosines @ patches @ cosines.T
    power *= power
    return np.asarray(np.sqrt(power.reshape(len(patches), -1) @ weights))


@cache
def _cosines(side: int) -> tuple[Float32, Float32]:
    """The cosine transform (side, side), and what each square adds to a variance (side², octaves).

    The variance is of the difference of two blurs, whose constant part is 0.
    """
    number = np.arange(side)
    cosines = np.cos(math.pi / side * (number + 0.5) * number[:, None]) * math.sqrt(2.0 / side)
    cosines[0] *= math.sqrt(0.5)
    sigma = np.array(_BLURS_PX)[:, None]
    passed = np.exp(-0.5 * (math.pi / side * number * sigma) ** 2)
    blurs = passed[:, :, None] * passed[:, None, :]
    weights = ((blurs[:-1] - blurs[1:]) / side) ** 2
    return cosines.astype(np.float32), weights.reshape(len(weights), -1).T.astype(np.float32)


def changed(reference: Signature, now: Signature) -> float:
    """Change of the blur: the second largest of the rows' median changes, in log-ratios [1].

    A change of the lens shows at most depths.
    """
    with np.errstate(all="ignore"):
        difference = now.ratios - reference.ratios
    rows = difference.swapaxes(1, 2).reshape(-1, _COLUMNS)
    known = np.isfinite(rows)
    counts = known.sum(axis=1)
    rows, counts, known = (one[counts >= _COLUMNS // 2] for one in (rows, counts, known))
    if len(rows) < 2:
        return 0.0
    ordered = np.sort(np.where(known, rows, np.inf), axis=1)
    each = np.arange(len(rows))
    medians = 0.5 * (ordered[each, (counts - 1) // 2] + ordered[each, counts // 2])
    return float(np.sort(np.abs(medians))[-2])


def calls_for_fit(reference: Signature, now: Signature, since: int, frame_s: float) -> bool:
    """Whether a file's lens is fitted again.

    Args:
        reference: of the frame of the last fit.
        now: of a later frame of the shot.
        since: frames between them [1].
        frame_s: from one frame to the next, > 0 [s].
    """
    change = changed(reference, now)
    if since >= max(2, round(SETTLED_S / frame_s)):
        return change > SETTLED_CHANGE
    return since >= max(1, round(SPACING_S / frame_s)) and change > CHANGED


def is_cut(before: Signature, now: Signature) -> bool:
    """Whether another shot begins between two neighbouring frames."""
    return float(np.abs(now.light - before.light).mean()) > CUT


def stands_still(before: Signature, now: Signature) -> bool:
    """Whether most of the view is the same."""
    return float(np.median(np.abs(now.light - before.light))) < _STILL


def differs(before: LensFit, now: LensFit, *, still: bool) -> bool:
    """Whether the lens has changed by more than the errors of two fits, on the ground in view.

    Where the sign of either is ambiguous, unsigned diameters are compared.

    Args:
        before: of an earlier frame.
        now: of a later one, of a frame of the same size.
        still: whether the camera stands still between them.
    """
    seen = [disparity for disparity, _ in before.ground_seen] or [0.0]
    there = np.array([seen[0], seen[len(seen) // 2], seen[-1]], np.float32)
    was, is_now = before.coc_px(there), now.coc_px(there)
    if "ambiguous" in (before.sign, now.sign):
        was, is_now = np.abs(was), np.abs(is_now)
    change = np.abs(is_now - was)
    errors = [fit.readings_share * fit.coc_stderr_px(there) for fit in (now, before)]
    error = np.hypot(*errors)
    told = change > (_TOLD_STILL if still else _TOLD_MOVING) * error
    return bool(np.any(told & (change > IN_FOCUS_PX)))
