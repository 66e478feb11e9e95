"""How much of a light casters block: each sample of it is a projection of their triangles."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.effects.shadow.apply import Grid
from nlens_video.effects.shadow.casters import ClippedMesh, Occluder
from nlens_video.effects.shadow.coverage import PROJECTIONS, Bits, Projection, mark_covered
from nlens_video.effects.shadow.light_samples import project_along_light
from nlens_video.effects.shadow.transparency import absorb_veils, no_absorption
from nlens_video.kernels.thread_pool import parallel_for
from nlens_video.scene.patches import R2

_NEAREST = 1e-6  # depth at which a box is clipped, by the greatest of its corners
# of a box, as pairs of its corners in the order of `product`
_BOX_EDGES = np.array([(n, n | bit) for bit in (1, 2, 4) for n in range(8) if not n & bit])


class Query(Struct, frozen=True, eq=False):
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
    corners = np.array([*product(*bounds.T.tolist(), [1.0])])
    matrices = project_along_light(lights, ground_y, occluder.camera)
    columns, rows = _before_camera(corners @ matrices.swapaxes(1, 2))
    if not columns.size:
        return Box(0, 0, 0, 0)
    return Box(
        math.floor(max(columns.min(), seen.x0)), math.floor(max(rows.min(), seen.y0)),
        math.ceil(min(columns.max(), seen.x1)), math.ceil(min(rows.max(), seen.y1)),
    )  # fmt: skip


def _before_camera(places: Float64) -> tuple[Float64, Float64]:
    """Columns and rows (...) that bound what of boxes' projections lies before the camera [px].

    Args:
        places: homogeneous corners of the boxes (N, 8, 3), in the order of `product`.
    """
    depths = places[..., 2]
    if depths.min() > _NEAREST * depths.max():  # all of them
        return places[..., 0] / depths, places[..., 1] / depths
    ahead = depths - _NEAREST * np.abs(depths).max(axis=1)[:, None]  # (N, 8)
    one, other = (places[:, ends] for ends in _BOX_EDGES.T)
    a, b = (ahead[:, ends] for ends in _BOX_EDGES.T)
    crosses = (a > 0.0) != (b > 0.0)
    part = (a[crosses] / (a[crosses] - b[crosses]))[:, None]
    crossing = one[crosses] + part * (other[crosses] - one[crosses])
    column, row, depth = np.concatenate([places[ahead > 0.0], crossing]).T
    return column / depth, row / depth


class _Part(Struct, frozen=True, eq=False):
    """Samples of lights whose shadows at one moment are drawn together.

    Attributes:
        occluder: casts them.
        grid: the pixels.
        samples: numbers of the query and of the sample, at most `PROJECTIONS` of them.
        lights: the samples (N, 4).
        matrices: their projections on the grid (N, 3, 4).
    """

    occluder: Occluder
    grid: Grid
    samples: list[tuple[int, int]]
    lights: Float64
    matrices: Float64


def hidden_shares(
    occluders: Sequence[Occluder | None], queries: Sequence[Query], threads: int | None
) -> list[Float32]:
    """Share of each query's light that is blocked, on its grid.

    Samples of the light take turns with temporal samples (None: nothing above the ground), so the
    mean over moments costs no more than one moment. Queries with the same grid are drawn together.
    """
    parts = [
        part
        for grid in dict.fromkeys(one.grid for one in queries)
        for turn, occluder in enumerate(occluders)
        if occluder is not None
        for part in _parts(queries, grid, occluder, slice(turn, None, len(occluders)))
    ]
    counts: dict[_Part, dict[int, Float32 | Bits]] = {}

    def count(part: _Part) -> None:
        counts[part] = _counts(part)

    parallel_for(count, parts, threads)
    return [
        _share(one, [counts[part][number] for part in parts if number in counts[part]])
        for number, one in enumerate(queries)
    ]


def _parts(
    queries: Sequence[Query], grid: Grid, occluder: Occluder, chosen: slice
) -> Iterator[_Part]:
    """Some samples of all queries on a grid, as far as they lie above the ground.

    Those of one moment go together: they share its triangles.
    """
    samples, lights = [], [np.zeros((0, 4))]
    for number, query in enumerate(queries):
        if query.grid is grid:
            own = np.arange(len(query.lights))[chosen]
            own = own[query.lights[own, 1] > query.lights[own, 3] * occluder.ground_y]
            samples += [(number, n) for n in own.tolist()]
            lights.append(query.lights[own])
    together = np.concatenate(lights)
    matrices = project_along_light(together, occluder.ground_y, grid.view(occluder.camera))
    for first in range(0, len(samples), PROJECTIONS):
        some = slice(first, first + PROJECTIONS)
        yield _Part(occluder, grid, samples[some], together[some], matrices[some])


def _share(query: Query, counts: Sequence[Float32 | Bits]) -> Float32:
    """Share of a query's light that is blocked (h, w), of the numbers of its blocked samples."""
    whole = np.zeros(query.grid.shape, np.min_scalar_type(query.count))
    part = np.zeros(query.grid.shape, np.float32)
    for one in counts:
        total = whole if one.dtype == np.uint8 else part
        total += one
    return np.asarray((part + whole) / np.float32(query.count), dtype=np.float32)


def _counts(part: _Part) -> dict[int, Float32 | Bits]:
    """Number of blocked samples (h, w) of each query that has some in a part."""
    occluder = part.occluder
    projections = [
        (bit, matrix, (((n + 1) * R2[0]) % 1.0, ((n + 1) * R2[1]) % 1.0))
        for bit, ((_, n), matrix) in enumerate(zip(part.samples, part.matrices, strict=True))
    ]
    bits = np.zeros(part.grid.shape, np.uint8)
    for below, alike in _by_mesh(occluder.opaque, part.lights, projections):
        mark_covered(bits, (below.vertices, below.faces, below.edges), alike)
    marks = dict[int, int]()  # bits of each query
    for bit, (query, _) in enumerate(part.samples):
        marks[query] = marks.get(query, 0) | 1 << bit
    opaque = {query: np.bitwise_count(bits & np.uint8(own)) for query, own in marks.items()}
    if not occluder.transparent:
        return opaque
    absorptions = {query: no_absorption(*part.grid.shape) for query in marks}
    for (query, n), light, (bit, matrix, at) in zip(
        part.samples, part.lights, projections, strict=True
    ):
        veils = occluder.veils
        if light[3] > 0.0:
            veils = tuple((mesh.below(light[1]), opacity) for mesh, opacity in veils)
        absorb_veils(absorptions[query], (bits, bit), veils, matrix, n + 1, at)
    return {
        query: count.astype(np.float32) + absorptions[query].taken
        for query, count in opaque.items()
    }


def _by_mesh(
    mesh: ClippedMesh, lights: Float64, projections: Sequence[Projection]
) -> list[tuple[ClippedMesh, list[Projection]]]:
    """What of a mesh lies below each light, with the projections from the lights that see it so."""
    found: dict[ClippedMesh, list[Projection]] = {}
    for light, projection in zip(lights, projections, strict=True):
        below = mesh if light[3] == 0.0 else mesh.below(light[1])
        found.setdefault(below, []).append(projection)
    return list(found.items())
