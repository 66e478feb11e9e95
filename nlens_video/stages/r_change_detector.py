"""Change detector for the lens: compares the plate's blur with that at the last fit.

Estimating the CoC takes a tenth of a second; this takes a few milliseconds. Patches on a grid
are split in octaves of detail. Blur takes detail away octave by octave, whatever the light and the
contrast, so the ratio between neighbouring octaves is what is watched: by rows of patches, since
the depth of a ground, and so its blur, goes by rows; and by medians, so that what moves through
the view does not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Box, Float32, Float64, Picture

CHANGED = 0.1
"""Change of the log-ratio of two octaves that calls for another fit: a focus that moves by 7 %
gives as much, or an aperture that opens by a fifth; noise and a panning camera seldom do."""

CUT = 0.12
"""Change of the patches' brightness, in the mean, from one frame to the next that is a cut [1]."""

_ROWS, _COLUMNS = 6, 8
_PATCH_SHARE = 1 / 16  # of the frame's width
_SMALLEST_PX, _LARGEST_PX = 24, 64
_BLURS_PX = (0.8, 1.6, 3.2, 6.4)  # between which the octaves lie
_FLOOR = 1.5e-3  # detail of less than this is noise (root of scene-linear light) [1]


@dataclass(frozen=True, slots=True)
class Signature:
    """Signature of a frame's blur and light on a grid of patches.

    Attributes:
        ratios: log-ratios of neighbouring octaves (rows, columns, octaves - 1), nan where a patch
            has no detail.
        light: mean of each patch (rows, columns), root of scene-linear light [1].
    """

    ratios: Float64
    light: Float64


def signature(picture: Picture) -> Signature:
    """Signature of a frame, which is not changed."""
    side = int(min(max(_PATCH_SHARE * picture.width, _SMALLEST_PX), _LARGEST_PX))
    side = min(side, picture.width, picture.height)
    patches = np.empty((side, side, _ROWS * _COLUMNS), np.float32)
    for at in range(_ROWS * _COLUMNS):
        row, column = divmod(at, _COLUMNS)
        y = (picture.height - side) * (2 * row + 1) // (2 * _ROWS)
        x = (picture.width - side) * (2 * column + 1) // (2 * _COLUMNS)
        patches[..., at] = picture.linear(Box(x, y, x + side, y + side))[..., 1]
    root = np.sqrt(np.maximum(patches, 0.0))
    grid = (_ROWS, _COLUMNS)
    return Signature(_octaves(root).reshape(*grid, -1), root.mean(axis=(0, 1)).reshape(grid))


def _octaves(patches: Float32) -> Float64:
    """Log-ratios of detail in neighbouring octaves, nan where it is noise (N, octaves - 1).

    Args:
        patches: one a channel (side, side, N).
    """
    soft = [
        cv2.GaussianBlur(patches, (0, 0), blur, borderType=cv2.BORDER_REFLECT) for blur in _BLURS_PX
    ]
    bands = zip(soft[:-1], soft[1:], strict=True)
    detail = np.stack([(fine - coarse).std(axis=(0, 1)) for fine, coarse in bands], axis=1)
    ratios = np.diff(np.log(np.maximum(detail, _FLOOR)).astype(np.float64), axis=1)
    ratios[detail[:, 1:] <= _FLOOR] = np.nan
    return np.asarray(ratios)


def changed(reference: Signature, now: Signature) -> float:
    """How far the blur has changed, in log-ratios of octaves [1].

    The second largest of the rows' median changes: a change of the lens shows at most depths.
    """
    with np.errstate(all="ignore"):
        difference = now.ratios - reference.ratios
    rows = []
    for row in difference:
        for octave in row.T:
            seen = octave[np.isfinite(octave)]
            if len(seen) >= _COLUMNS // 2:
                rows.append(abs(float(np.median(seen))))
    rows.sort()
    return rows[-2] if len(rows) >= 2 else 0.0


def is_cut(before: Signature, now: Signature) -> bool:
    """Whether another shot begins between two neighbouring frames."""
    return float(np.abs(now.light - before.light).mean()) > CUT
