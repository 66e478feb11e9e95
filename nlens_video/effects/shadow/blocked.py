"""How much of a light casters block: each sample of it is a projection of their triangles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.effects.shadow.apply import Grid
from nlens_video.effects.shadow.casters import ClippedMesh, Occluder, project_along_light
from nlens_video.effects.shadow.coverage import PROJECTIONS, Bits, Projection, mark_covered
from nlens_video.effects.shadow.transparency import absorb, no_absorption
from nlens_video.kernels.thread_pool import parallel_for
from nlens_video.scene.patches import R2

_NEAREST = 1e-6  # depth at which a box is clipped, by the greatest of its corners
# of a box, as pairs of its corners in the order of `product`
_BOX_EDGES = np.array([(n, n | bit) for bit in (1, 2, 4) for n in range(8) if not n & bit])


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """Samples of a light whose blocked share is computed on a grid.

    Attributes:
        lights: points (x, y, z, 1), or directions towards distant light (x, y, z, 0) (N, 4).
        count: samples that they stand for, neglected ones included [1].
        grid: the pixels.
    """

    lights: Float64
    count: int
    grid: Grid


def reached(occluder: Occluder, lights: Float64, seen: Box) -> Box:
    """The part of a box of the frame that an occluder's shadows from lights (N, 4) can reach."""
    ground_y, bounds = occluder.ground_y, occluder.bounds
    lights = lights[lights[:, 1] > lights[:, 3] * ground_y]
    if not len(lights):
        return Box(0, 0, 0, 0)
    if ((lights[:, 3] > 0.0) & (lights[:, 1] <= bounds[1, 1])).any():
        return seen  # nothing bounds the shadow of what is as high as a lamp
    corners = np.array([[*corner, 1.0] for corner in product(*bounds.T)])
    matrices = project_along_light(lights, ground_y, occluder.camera)
    columns, rows = _before_camera(corners @ matrices.swapaxes(1, 2))
    if not len(columns):
        return Box(0, 0, 0, 0)
    return Box(
        math.floor(max(columns.min(), seen.x0)), math.floor(max(rows.min(), seen.y0)),
        math.ceil(min(columns.max(), seen.x1)), math.ceil(min(rows.max(), seen.y1)),
    )  # fmt: skip


def _before_camera(places: Float64) -> tuple[Float64, Float64]:
    """Columns and rows (M,) that bound what of boxes' projections lies before the camera [px].

    Args:
        places: homogeneous corners of the boxes (N, 8, 3), in the order of `product`.
    """
    nearest = _NEAREST * np.abs(places[..., 2]).max(axis=1)[:, None]
    ahead = places[..., 2] - nearest  # (N, 8)
    one, other = (places[:, ends] for ends in _BOX_EDGES.T)
    a, b = (ahead[:, ends] for ends in _BOX_EDGES.T)
    crosses = (a > 0.0) != (b > 0.0)
    part = (a[crosses] / (a[crosses] - b[crosses]))[:, None]
    crossing = one[crosses] + part * (other[crosses] - one[crosses])
    column, row, depth = np.concatenate([places[ahead > 0.0], crossing]).T
    return column / depth, row / depth


def hidden_shares(
    occluders: Sequence[Occluder | None], queries: Sequence[Query], threads: int | None
) -> list[Float32]:
    """Share of each query's light that is blocked, on its grid.

    Samples of the light take turns with temporal samples (None: nothing above the ground), so the
    mean over moments costs no more than one moment.
    """
    # samples of one moment go together: they share its triangles
    work = [
        (number, moment, first)
        for number, one in enumerate(queries)
        for moment in range(len(occluders))
        for first in range(moment, len(one.lights), len(occluders) * PROJECTIONS)
    ]
    done: dict[tuple[int, int, int], Float32 | Bits] = {}

    def count(part: tuple[int, int, int]) -> None:
        number, moment, first = part
        query, occluder = queries[number], occluders[moment]
        if occluder is not None:
            samples = range(first, len(query.lights), len(occluders))[:PROJECTIONS]
            done[part] = _counts(occluder, query, samples)

    parallel_for(count, work, threads)
    return [
        _share(one, [done[part] for part in work if part[0] == number and part in done])
        for number, one in enumerate(queries)
    ]


def _share(query: Query, counts: Sequence[Float32 | Bits]) -> Float32:
    """Share of a query's light that is blocked (h, w), of the numbers of its blocked samples."""
    whole = np.zeros(query.grid.shape, np.min_scalar_type(query.count))
    part = np.zeros(query.grid.shape, np.float32)
    for one in counts:
        total = whole if one.dtype == np.uint8 else part
        total += one
    return np.asarray((part + whole) / np.float32(query.count), dtype=np.float32)


def _counts(occluder: Occluder, query: Query, samples: Sequence[int]) -> Float32 | Bits:
    """Number of blocked samples (h, w) among some of a query, at most `PROJECTIONS`."""
    height, width = query.grid.shape
    view = query.grid.view(occluder.camera)
    above = [n for n in samples if query.lights[n][1] > query.lights[n][3] * occluder.ground_y]
    matrices = project_along_light(query.lights[above], occluder.ground_y, view)
    projections = [
        (bit, matrix, (((n + 1) * R2[0]) % 1.0, ((n + 1) * R2[1]) % 1.0))
        for bit, (n, matrix) in enumerate(zip(above, matrices, strict=True))
    ]
    bits = np.zeros((height, width), np.uint8)
    for below, alike in _by_mesh(occluder.opaque, query.lights[above], projections):
        mark_covered(bits, (below.vertices, below.faces, below.edges), alike)
    if not occluder.transparent:
        return np.bitwise_count(bits)
    absorption = no_absorption(height, width)
    for number, (bit, matrix, at) in zip(above, projections, strict=True):
        light = query.lights[number]
        for whole, opacity in occluder.transparent:
            mesh = whole if light[3] == 0.0 else whole.below(light[1])
            points = mesh.vertices[:, :3] @ matrix[:, :3].T + matrix[:, 3]
            surface = np.ascontiguousarray(mesh.vertices[:, 3:])
            texture = (opacity.alpha, opacity.wrap, opacity.cutoff)
            absorb(absorption, (bits, bit), points, surface, mesh.faces, texture, number + 1, at)
    return np.bitwise_count(bits).astype(np.float32) + absorption.taken


def _by_mesh(
    mesh: ClippedMesh, lights: Float64, projections: Sequence[Projection]
) -> list[tuple[ClippedMesh, list[Projection]]]:
    """What of a mesh lies below each light, with the projections from the lights that see it so."""
    found: dict[ClippedMesh, list[Projection]] = {}
    for light, projection in zip(lights, projections, strict=True):
        below = mesh if light[3] == 0.0 else mesh.below(light[1])
        found.setdefault(below, []).append(projection)
    return list(found.items())
