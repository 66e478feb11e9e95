"""Localisation of targets in a merged blob, where they occlude each other.

Each target has its appearance model and its predicted box. They are moved sideways until colours
and silhouettes, nearer targets over farther ones, best explain the foreground mask and the frame.
"""

from __future__ import annotations

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.appearance import AppearanceModel

_SEARCH_RANGE = 0.15  # search to either side of the predicted box, by its height [1]
_PREDICTION_SIGMA = 0.06  # standard deviation of the error of prediction, by that height [1]
_COARSE_STEP_PX = 3  # step of the first, coarse search [lowres px]
_MISS_RATE = 0.05  # fraction of a target's pixels missing from the foreground mask [1]
_OUTLIER_LIKELIHOOD = 1e-5  # likelihood of a foreground pixel that no target covers [1]
_CORRELATED_PIXELS = 12.0  # neighbouring pixels that count as one independent observation


class MergedTarget(Struct, frozen=True):
    """One of the targets in a merged blob.

    Attributes:
        appearance: its appearance model.
        predicted: its box as predicted from its motion, centred on the torso.
    """

    appearance: AppearanceModel
    predicted: Box


class Localization(Struct, frozen=True):
    """Where a target of a merged blob is.

    Attributes:
        box: its box, centred on the torso.
        visibility: fraction of it that no nearer target hides [1].
        evidence: log-likelihood ratio of the frame with the target and without it.
    """

    box: Box
    visibility: float
    evidence: float


def localize(
    targets: list[MergedTarget], roots: Float32, mask: Bool, blob_box: Box
) -> list[Localization]:
    """Localise the targets of a merged blob by maximum a posteriori estimation.

    Coordinate ascent: one target is moved at a time, the nearest first; a coarse search, then a
    fine one.

    Args:
        targets: the nearest first.
        roots: square root of the frame's light (h, w, 3).
        mask: its foreground mask (h, w).
        blob_box: bounding box of the blob.
    """
    window = blob_box
    for one in targets:
        window = window.union(one.predicted.expanded(_search_px(one.predicted)))
    window = window.intersection(Box(0, 0, *mask.shape[::-1]))
    crop = window.slices_in(Box(0, 0, *mask.shape[::-1]))
    inside = mask[crop]
    colours = [
        one.appearance.colour_likelihood(roots[crop], one.predicted, window) for one in targets
    ]
    shifts = [0] * len(targets)
    moved = [_Moved.of(one, window) for one in targets]
    covers = [one.by(0) for one in moved]
    for step, limit in ((_COARSE_STEP_PX, None), (1, _COARSE_STEP_PX - 1)):
        for number, one in enumerate(targets):
            reach, scores = limit or _search_px(one.predicted), {}
            for shift in range(shifts[number] - reach, shifts[number] + reach + 1, step):
                others = [*covers[:number], moved[number].by(shift), *covers[number + 1 :]]
                error = shift / (_PREDICTION_SIGMA * one.predicted.height + 1.0)
                scores[shift] = _log_likelihood(others, colours, inside) - 0.5 * error * error
            shifts[number] = max(scores, key=lambda shift: (scores[shift], -abs(shift)))
            covers[number] = moved[number].by(shifts[number])
    whole = _log_likelihood(covers, colours, inside)
    found, visible = list[Localization](), np.ones(inside.shape, np.float32)
    for number, (one, cover) in enumerate(zip(targets, covers, strict=True)):
        visibility = float((visible * cover * inside).sum() / max(float(cover.sum()), 1.0))
        visible = visible * (1.0 - cover)
        others = covers[:number] + covers[number + 1 :]
        without = _log_likelihood(others, colours[:number] + colours[number + 1 :], inside)
        box = one.predicted.translated(shifts[number], 0)
        found.append(Localization(box, visibility, whole - without))
    return found


class _Moved(Struct, frozen=True):
    """Coverage by a target that is moved sideways.

    Attributes:
        coverage: where it is predicted, `reach` columns beyond a window on both sides.
        reach: largest shift [px].
    """

    coverage: Float32
    reach: int

    @classmethod
    def of(cls, target: MergedTarget, window: Box) -> _Moved:
        """For all shifts that are searched."""
        reach = _search_px(target.predicted) + _COARSE_STEP_PX
        wide = Box(window.x0 - reach, window.y0, window.x1 + reach, window.y1)
        return cls(target.appearance.coverage(target.predicted, wide), reach)

    def by(self, shift: int) -> Float32:
        """Coverage of the window (h, w) [1]."""
        first = self.reach - shift
        return self.coverage[:, first : first + self.coverage.shape[1] - 2 * self.reach]


def _search_px(box: Box) -> int:
    """Range of the coarse search to either side of a predicted box [px]."""
    return _COARSE_STEP_PX * max(1, round(_SEARCH_RANGE * box.height / _COARSE_STEP_PX))


def _log_likelihood(covers: list[Float32], colours: list[Float32], inside: Bool) -> float:
    """Log-likelihood of a window of the frame and of its foreground mask.

    Args:
        covers: coverage of each target (h, w) [1], the nearest first.
        colours: likelihood of the colours for each target (h, w) [1].
        inside: the foreground mask (h, w).
    """
    visible = np.ones(inside.shape, np.float32)
    likely = np.zeros(inside.shape, np.float32)
    for cover, colour in zip(covers, colours, strict=True):
        likely += visible * cover * colour
        visible = visible * (1.0 - cover)
    likely += visible * np.float32(_OUTLIER_LIKELIHOOD)
    empty = 1.0 - (1.0 - _MISS_RATE) * (1.0 - visible)
    return float(cv2.log(np.where(inside, likely, empty)).sum()) / _CORRELATED_PIXELS
