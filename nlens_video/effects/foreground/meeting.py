"""Where things are that meet: they make one region, in which each has its colours and outline."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.looks import Look

_REACH = 0.15  # of its height, by which a thing may be beside where it is expected [1]
_SPREAD = 0.06  # standard deviation of that [1]
_COARSE = 3  # pixels from one place to the next at which a thing is first tried
_MISSED = 0.05  # of a thing's pixels that differ too little from the background [1]
_STRAY = 1e-5  # likelihood of a pixel of the region that none of the things explains [1]
_ALIKE = 12.0  # pixels of the small picture that tell as much as one that stands alone


@dataclass(frozen=True, slots=True)
class Member:
    """One of the things that meet.

    Attributes:
        look: its colours and outline.
        expected: where it would be if it went on as it went, around the middle of its upper half.
    """

    look: Look
    expected: Box


@dataclass(frozen=True, slots=True)
class Placed:
    """Where one of them is.

    Attributes:
        box: of it.
        seen: share of it that none of the others hides [1].
        evidence: logarithm of how much likelier the picture is with it than without.
    """

    box: Box
    seen: float
    evidence: float


def place(members: list[Member], roots: Float32, mask: Bool, region: Box) -> list[Placed]:
    """Where the things of a region are.

    Of each place the colours and outlines of all things explain the region and its surroundings;
    the likeliest is sought for each thing in turn, the nearest first.

    Args:
        members: the things, the nearest first.
        roots: square root of the picture's light (h, w, 3).
        mask: where it shows things (h, w).
        region: around the region that they make.
    """
    where = region
    for one in members:
        where = where.union(one.expected.expanded(_reach(one.expected)))
    where = where.intersection(Box(0, 0, *mask.shape[::-1]))
    cut = where.slices_in(Box(0, 0, *mask.shape[::-1]))
    inside = mask[cut]
    colours = [one.look.likelihood(roots[cut], one.expected, where) for one in members]
    shifts = [0] * len(members)
    covers = [one.look.cover(one.expected, where) for one in members]
    for step, reach in ((_COARSE, None), (1, _COARSE - 1)):
        for number, one in enumerate(members):
            far, tried = reach or _reach(one.expected), {}
            for shift in range(shifts[number] - far, shifts[number] + far + 1, step):
                moved = one.look.cover(one.expected.moved(shift, 0), where)
                others = [*covers[:number], moved, *covers[number + 1 :]]
                away = shift / (_SPREAD * one.expected.height + 1.0)
                tried[shift] = _explained(others, colours, inside) - 0.5 * away * away
            shifts[number] = max(tried, key=lambda shift: (tried[shift], -abs(shift)))
            covers[number] = one.look.cover(one.expected.moved(shifts[number], 0), where)
    whole = _explained(covers, colours, inside)
    found, open_share = list[Placed](), np.ones(inside.shape, np.float32)
    for number, (one, cover) in enumerate(zip(members, covers, strict=True)):
        seen = float((open_share * cover * inside).sum() / max(float(cover.sum()), 1.0))
        open_share = open_share * (1.0 - cover)
        others = covers[:number] + covers[number + 1 :]
        without = _explained(others, colours[:number] + colours[number + 1 :], inside)
        box = one.expected.moved(shifts[number], 0)
        found.append(Placed(box, seen, whole - without))
    return found


def _reach(box: Box) -> int:
    return _COARSE * max(1, round(_REACH * box.height / _COARSE))


def _explained(covers: list[Float32], colours: list[Float32], inside: Bool) -> float:
    """Logarithm of the likelihood of a region (h, w), and of its surroundings."""
    open_share = np.ones(inside.shape, np.float32)
    likely = np.zeros(inside.shape, np.float32)
    for cover, colour in zip(covers, colours, strict=True):
        likely += open_share * cover * colour
        open_share = open_share * (1.0 - cover)
    likely += open_share * np.float32(_STRAY)
    empty = 1.0 - (1.0 - _MISSED) * (1.0 - open_share)
    return float(cv2.log(np.where(inside, likely, empty)).sum()) / _ALIKE
