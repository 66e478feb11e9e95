"""The casters as points of a light see them: shadow maps (Williams 1978) of their outline.

The outline is exact, as on the ground. How far off the first surface lies is known on coarse cells
only: it tells things behind the object from things before it.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.shadow.ambient import surface_points
from nlens_video.effects.shadow.casters import Occluder
from nlens_video.native import kernels
from nlens_video.scene.gltf.meshes import Int32
from nlens_video.scene.patches import R2

_LARGEST = 512  # side of a map [px]
_CELLS = 24  # each way, in which the nearest of the sampled points is kept
_WIDEST = 3.0  # tangent of the angle that a near lamp's map reaches to
SAMPLES = 2048
"""Points of a caster's surface."""


class SampledCasters(Struct, frozen=True, eq=False):
    """Casters at one moment with points of their surfaces.

    Attributes:
        occluder: the casters.
        points: on all their surfaces (P, 3) [scene unit].
    """

    occluder: Occluder
    points: Float32

    @classmethod
    def of(cls, occluder: Occluder | None) -> SampledCasters | None:
        """The casters with their points; None for none."""
        if occluder is None:
            return None
        meshes = (occluder.opaque, *(mesh for mesh, _ in occluder.transparent))
        found = [surface_points(m.vertices, m.faces, SAMPLES) for m in meshes if len(m.faces)]
        return cls(occluder, np.concatenate(found).astype(np.float32))


class LightViews(Struct, frozen=True, kw_only=True, eq=False):
    """Where lines from points of a light meet maps of the casters at one moment.

    Attributes:
        matrices: world points to homogeneous places in the maps and nearness to the light
            (N, 3, 4): (column, row, nearness) of distant light, else (column * w, row * w, w), and
            the nearness is -w.
        far: whether the light is distant.
        sizes: columns and rows of the maps (N, 2), 0 without casters [px].
        at: where in each pixel they are sampled (N, 2) [px].
        sides: width of the cells of `first` (N,) [px].
        first: nearness of the first surface in cells of the maps (N, cells, cells).
        nearest: the largest nearness (N,).
        numbers: of the light's points, which decide where transparent surfaces let light pass.
        casters: what is drawn in the maps; None for nothing.
    """

    matrices: Float64
    far: bool
    sizes: Int32
    at: Float64
    sides: Int32
    first: Float32
    nearest: Float64
    numbers: range
    casters: SampledCasters | None

    @classmethod
    def of(
        cls, lights: Float64, numbers: range, casters: SampledCasters | None, cell: float
    ) -> LightViews:
        """The views from points of a light.

        Args:
            lights: places (x, y, z, 1), or directions towards distant light (x, y, z, 0) (N, 4).
            numbers: which of them see these casters (M of the N).
            casters: what they see.
            cell: width of the maps' pixels at the casters [scene unit].
        """
        lights = lights[numbers.start : numbers.stop : numbers.step]
        count, far = len(lights), bool((lights[:, 3] == 0.0).all())
        matrices, sizes = np.zeros((count, 3, 4)), np.zeros((count, 2), np.int32)
        if casters is not None:
            matrices, sizes = _projections(lights, casters.occluder.bounds, cell, far=far)
        at = (np.array(numbers)[:, None] + 1) * R2 % 1.0
        sides = np.maximum(-(-sizes.max(axis=1) // _CELLS), 1).astype(np.int32)
        first, nearest = np.zeros((count, _CELLS, _CELLS), np.float32), np.zeros(count)
        if casters is not None:
            kernels.first_surfaces(
                casters.points, (matrices, int(far), sizes), sides, first, nearest
            )
        return cls(
            matrices=matrices, far=far, sizes=sizes, at=at, sides=sides, first=first,
            nearest=nearest, numbers=numbers, casters=casters,
        )  # fmt: skip

    def some(self, first: int, last: int) -> LightViews:
        """Those with an index from the first to before the last."""
        part = slice(first, last)
        return LightViews(
            matrices=self.matrices[part], far=self.far, sizes=self.sizes[part], at=self.at[part],
            sides=self.sides[part], first=self.first[part], nearest=self.nearest[part],
            numbers=self.numbers[part], casters=self.casters,
        )  # fmt: skip

    @property
    def projection(self) -> tuple[Float64, int, Int32]:
        """Matrices, whether they are of distant light, and sizes."""
        return self.matrices, int(self.far), self.sizes

    def may_block(self, points: Float32) -> Bool:
        """Which of some points (M, 3) may lie in the casters' shadow."""
        found = np.zeros(len(points), bool)
        if self.casters is not None:
            kernels.may_be_blocked(points, self.projection, self.nearest, found)
        return found


def _projections(
    lights: Float64, bounds: Float64, cell: float, *, far: bool
) -> tuple[Float64, Int32]:
    """Matrices (N, 3, 4) and sizes (N, 2) of maps from lights (N, 4) of one kind."""
    middle = bounds.mean(axis=0)
    toward = lights[:, :3] - (0.0 if far else middle)
    distance = np.linalg.norm(toward, axis=1)
    axis = toward / np.maximum(distance, np.finfo(np.float64).tiny)[:, None]
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(axis, first), axis if far else -axis], axis=1)
    origin = np.broadcast_to(middle, toward.shape) if far else lights[:, :3]
    matrices = np.concatenate([axes, -axes @ origin[..., None]], axis=2)
    corners = np.array([[*corner, 1.0] for corner in product(*bounds.T)])
    seen = corners @ matrices.swapaxes(1, 2)  # (N, 8, 3)
    if far:
        low, high = seen[..., :2].min(axis=1), seen[..., :2].max(axis=1)
    else:
        matrices[:, :2] *= distance[:, None, None]
        reach = distance[:, None]
        ahead = np.maximum(seen[..., 2:], reach[..., None] / _WIDEST)
        seen = reach[..., None] * seen / ahead
        low, high = (
            np.clip(end, -_WIDEST * reach, _WIDEST * reach)
            for end in (seen[..., :2].min(axis=1), seen[..., :2].max(axis=1))
        )
    cells = np.maximum((high - low).max(axis=1, keepdims=True) / _LARGEST, cell)
    matrices[:, :2] /= cells[..., None]
    shift = 1.0 - low / cells
    matrices[:, :2] += shift[..., None] * (np.eye(4)[3] if far else matrices[:, 2:])
    sizes = np.maximum(np.ceil((high - low) / cells), 1.0) + 2.0
    return np.ascontiguousarray(matrices), sizes.astype(np.int32)


def views_of(
    lights: Float64, casters: list[SampledCasters | None], cell: float
) -> list[LightViews]:
    """Views from points of a light (N, 4), which take turns with the moments of the casters."""
    turns = len(casters)
    return [
        LightViews.of(lights, range(moment, len(lights), turns), one, cell)
        for moment, one in enumerate(casters[: len(lights)])
    ]
