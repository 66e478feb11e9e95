"""Maps of the casters from points of a light, and surface points looked up in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32
from nlens_video.effects.shadow.coverage import PROJECTIONS, Bits, mark_covered
from nlens_video.effects.shadow.light_views import LightViews
from nlens_video.effects.shadow.transparency import absorb_veils, no_absorption
from nlens_video.kernels.thread_pool import bands, parallel_for
from nlens_video.native import kernels

_BAND = 8192  # points that a thread looks up at a time
_NO_WEIGHTS = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32)


class ShadowMaps(Struct, frozen=True, eq=False):
    """Maps of the casters from at most `PROJECTIONS` points of a light.

    Attributes:
        views: from these points (n).
        bits: where opaque casters cover each map (h, w), one bit a view.
        taken: share of the light that transparent ones take (n, h, w), (0, h, w) without any [1].
    """

    views: LightViews
    bits: Bits
    taken: Float32

    @classmethod
    def of(cls, views: LightViews) -> ShadowMaps:
        """The maps of some views, at most `PROJECTIONS`."""
        columns, rows = (int(side) for side in views.sizes.max(axis=0))
        bits = np.zeros((rows, columns), np.uint8)
        if views.casters is None:
            return cls(views, bits, np.zeros((0, rows, columns), np.float32))
        matrices = views.matrices
        if views.far:
            matrices = matrices.copy()
            matrices[:, 2] = np.eye(4)[3]
        at = [(float(column), float(row)) for column, row in views.at]
        opaque, veils = views.casters.occluder.opaque, views.casters.occluder.veils
        projections = [(bit, *one) for bit, one in enumerate(zip(matrices, at, strict=True))]
        mark_covered(bits, (opaque.vertices, opaque.faces, opaque.edges), projections)
        taken = np.zeros((len(at) if veils else 0, rows, columns), np.float32)
        for bit, one in enumerate(taken):
            absorption = no_absorption(rows, columns)
            number = views.numbers[bit] + 1
            absorb_veils(absorption, (bits, bit), veils, matrices[bit], number, at[bit])
            one[:] = absorption.taken
        return cls(views, bits, taken)


def draw(views: Sequence[LightViews], threads: int | None = None) -> list[ShadowMaps]:
    """The maps of all views, in their order."""
    made: dict[int, ShadowMaps] = {}

    def one_part(number: int) -> None:
        made[number] = ShadowMaps.of(parts[number])

    parts = [
        one.some(first, first + PROJECTIONS)
        for one in views
        for first in range(0, len(one.numbers), PROJECTIONS)
    ]
    parallel_for(one_part, range(len(parts)), threads)
    return [made[number] for number in range(len(parts))]


def blocked(
    maps: Sequence[ShadowMaps],
    points: Float32,
    weights: tuple[Float32, Float32] | None = None,
    threads: int | None = None,
) -> Float32:
    """How many of the maps' lights are blocked at points, and how many there are (2, M).

    Args:
        maps: of the casters.
        points: on surfaces (M, 3) [scene unit].
        weights: unit normals of the surfaces (M, 3) and vectors to all lights (N, 3), as long as
            they are bright: each light then counts by its irradiance; default: each counts 1.
        threads: limit.
    """
    found = np.empty((2, len(points)), np.float32)

    def look_up(band: tuple[int, int]) -> None:
        part = slice(*band)
        sums = np.zeros((2, band[1] - band[0]), np.float32)
        for one in maps:
            views, own = one.views, _NO_WEIGHTS
            if weights is not None:
                own = weights[0][part], weights[1][np.array(views.numbers)]
            drawn = (views.sides, views.first, views.at, one.bits, one.taken)
            kernels.add_blocked(points[part], views.projection, drawn, own, sums)
        found[:, part] = sums

    parallel_for(look_up, bands(len(points), _BAND), threads)
    return found
