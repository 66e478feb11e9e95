"""Depth of the object as its lights see it: shadows of its parts on each other.

Shadow maps (Williams 1978) with percentage-closer soft shadows (Fernando 2005): what lies before a
point within the cone of the light's disc is looked up in a map of what the light sees, and blocks
it in part. Each pixel of a map is compared with the plane of the point's triangle there, so that a
surface does not shade itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from operator import is_

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.thread_pool import parallel_for, processors
from nlens_video.native import kernels
from nlens_video.render.base.mapped_lamps import mapped_lamps
from nlens_video.render.base.opacity import Opacities
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf.materials import ALPHA_ROUNDING
from nlens_video.scene.illumination import Lamp
from nlens_video.scene.posed import PosedMesh, PosedScene, bounds_of

SIDES = 128, 1024
"""Least and greatest width and height of a map [px]."""
CELL: int = kernels.LIGHT_DEPTH_CELL
"""Width and height of the cells whose highest nearness is known [px]."""
_SOFTEST = 1 / 16  # largest radius of the filter; shadows that are softer still come out harder [1]
_STEPS = 4  # of the width from one power of two to the next
_BANDS = 2  # of a map, for each thread: some rows take longer than others
_MARGIN = 2  # around the object [px]
_LIFT = 0.02  # of points whose triangle faces away from the light [1]
_BESIDE = 1.1  # from its middle: maps of nearer lamps look at its bounds [its radius]
_HALF = 0.5 - ALPHA_ROUNDING  # alpha from which on blended surfaces block the light [1]
_TURN = math.atan(0.15)  # of a map: edges along the scene's axes lie across its pixels [rad]
_NOTHING = np.float32(-3.0e38)  # nearness where nothing is

Cutout = tuple[Float32, Float32, tuple[int, int], float]
"""What of a mesh is there: texture coordinates and factor of alpha (V, 3), the texture's alpha
(H, W), how it is wrapped, and the cutoff."""
SOLID: Cutout = np.zeros((0, 3), np.float32), np.ones((1, 1), np.float32), (0, 0), 0.0
"""Of a mesh without a cutout."""
DepthMaps = tuple[Float32, Float32, Float32]
"""Nearness (K, side, side), its highest around each cell (K, side / CELL, side / CELL), and
`LightDepth.rows`."""
NO_MAPS: DepthMaps = (
    np.zeros((0, 0, 0), np.float32), np.zeros((0, 0, 0), np.float32), np.zeros((0, 32), np.float32)
)  # fmt: skip
"""Of lights that nothing blocks."""


class LightDepth(Struct, frozen=True, kw_only=True, eq=False):
    """Maps of the object from some of its lights.

    Distances in a map are in its pixels, nearness too, so that a disc that looks 2 t wide from a
    point is t times as wide in the map, each way, as what it is cut by is nearer than the point.

    Attributes:
        lights: numbers of the lights (K,).
        shares: of each light's light that its map may take (K,) [1].
        matrices: world points to (column, row, nearness, 1) times a positive number (K, 4, 4).
        softness: tangent of half the angle that each light's disc is wide (K,).
        nearness: of the surfaces nearest to the light (K, side, side) [px].
        highest: of `nearness` in the cells around each cell (K, side / CELL, side / CELL) [px].
    """

    lights: tuple[int, ...]
    shares: tuple[float, ...]
    matrices: Float64
    softness: tuple[float, ...]
    nearness: Float32
    highest: Float32

    @classmethod
    def of(
        cls, posed: PosedScene, lamps: Sequence[Lamp], side: int, opacities: Opacities
    ) -> LightDepth | None:
        """Draw the maps of the strongest lamps that see the object from without.

        Args:
            posed: the object, at one moment.
            lamps: what lights it.
            side: width and height of the maps, a multiple of `CELL` within `SIDES` [px].
            opacities: of its surfaces.

        Returns:
            None where no lamp has a map, or nothing is drawn in it.
        """
        casters = _casters(posed, opacities)
        if not casters or not lamps:
            return None
        points = np.concatenate([mesh.positions for mesh, _ in casters])
        bounds = bounds_of(points).astype(np.float64)
        if not np.isfinite(bounds).all() or not np.ptp(bounds, axis=0).any():
            return None
        lights = mapped_lamps(lamps, bounds, kernels.LIGHT_DEPTH_MAPS)
        if not lights:
            return None
        matrices = np.stack([_matrix(lamps[number], bounds) for number in lights])
        places = _fitted(matrices, points, side)
        nearness, cells = _drawn(places, casters, side)
        return cls(
            lights=tuple(lights),
            shares=tuple(lights.values()),
            matrices=matrices,
            nearness=nearness,
            highest=_spread(cells),
            softness=tuple(math.tan(0.5 * lamps[number].diameter) for number in lights),
        )

    def rows(self, eye: Float64) -> Float32:
        """Numbers of each view (K, 32), for places relative to the eye (3,).

        Matrices (4, 4) of points and, of planes, (3, 4); softness, lift of points whose triangle
        faces away [px], the largest radius of the filter [px], and 0.
        """
        found, side = np.zeros((len(self.lights), 32)), self.nearness.shape[1]
        for row, matrix, softness in zip(found, self.matrices, self.softness, strict=True):
            own = matrix.copy()
            own[:, 3] += matrix[:, :3] @ eye
            row[:16], row[16:28] = own.ravel(), np.linalg.inv(own).T[:3].ravel()
            row[28:31] = softness, _LIFT * side, _SOFTEST * side
        return found.astype(np.float32)

    def maps(self, eye: Float64) -> DepthMaps:
        """What kernels look points up in that are given relative to the eye (3,)."""
        return self.nearness, self.highest, self.rows(eye)


class LightDepthCache:
    """Depth of an object, drawn again only where it or its lights have moved.

    It does not depend on what was drawn before, so that parts of a shot are as the whole.
    """

    def __init__(self) -> None:
        self._meshes: tuple[PosedMesh, ...] = ()  # held, so that identity tells them apart
        self._lamps: tuple[object, ...] = ()
        self._side = 0
        self._opacities = Opacities()
        self._depth: LightDepth | None = None

    def of(self, posed: PosedScene, camera: Camera, lamps: Sequence[Lamp]) -> LightDepth | None:
        """As `LightDepth.of`, for pictures of that camera."""
        side, lit = side_for(posed, camera), tuple(map(_key, lamps))
        same = len(self._meshes) == len(posed.meshes) and all(map(is_, self._meshes, posed.meshes))
        if not same or side != self._side or lit != self._lamps:
            self._meshes, self._lamps, self._side = posed.meshes, lit, side
            self._depth = LightDepth.of(posed, lamps, side, self._opacities)
        return self._depth


def no_light_depth(lamps: Sequence[Lamp]) -> LightDepth | None:
    """Of lamps that nothing blocks."""
    return None


def _key(lamp: Lamp) -> tuple[object, ...]:
    posed = lamp.posed
    return posed.light, posed.position.tobytes(), posed.direction.tobytes(), lamp.diameter


def _casters(posed: PosedScene, opacities: Opacities) -> list[tuple[PosedMesh, Cutout]]:
    """Meshes that are opaque, at least in places, and where; glass lets the light through.

    What alpha blends counts as opaque where it hides half of what is behind it.
    """
    found = []
    for mesh in posed.drawn:
        opacity = opacities.of(mesh.geometry)
        if opacity is None:
            found.append((mesh, SOLID))
        elif not mesh.geometry.material.layers.transmission:
            surface = opacities.texturing(mesh.geometry)
            cutoff = opacity.cutoff if opacity.cutoff >= 0.0 else _HALF
            found.append((mesh, (surface, opacity.alpha, opacity.wrap, cutoff)))
    return found


def _matrix(lamp: Lamp, bounds: Float64) -> Float64:
    """World points to places in the lamp's map (4, 4), in scene units about the object's middle."""
    posed, middle = lamp.posed, bounds.mean(axis=0)
    far = posed.light.kind == "directional"
    toward = -posed.direction if far else posed.position - middle
    distance = float(np.linalg.norm(toward))
    if not far and distance < _BESIDE * 0.5 * float(np.linalg.norm(bounds[1] - bounds[0])):
        toward = posed.position - np.clip(posed.position, *bounds)  # all is before the lamp then
    axis = toward / np.linalg.norm(toward)
    first, second = _across(axis)
    axes = np.stack([
        math.cos(_TURN) * first + math.sin(_TURN) * second,
        math.cos(_TURN) * second - math.sin(_TURN) * first,
        axis,
    ])  # fmt: skip
    matrix = np.eye(4)
    if far:
        matrix[:3, :3], matrix[:3, 3] = axes, -axes @ middle
    else:  # nearness is the distance squared by the depth, so that planes stay planes
        matrix[:3, :3] = axes * [[distance], [distance], [0.0]]
        matrix[:2, 3] = -distance * axes[:2] @ posed.position
        matrix[2, 3] = distance * distance
        matrix[3] = np.append(-axis, axis @ posed.position)
    return matrix


def _across(axis: Float64) -> tuple[Float64, Float64]:
    """Two unit vectors (3,) across one (3,), which turn evenly with it (Duff et al. 2017)."""
    x, y, z = axis
    sign = math.copysign(1.0, y)
    part = -1.0 / (sign + y)
    first = np.array([sign * x * z * part, -sign * z, 1.0 + sign * z * z * part])
    return first, np.array([sign + x * x * part, -x, x * z * part])


def _fitted(matrices: Float64, points: Float32, side: int) -> Float32:
    """Places (K, V, 3) of some points (V, 3); matrices are changed so that the maps hold them."""
    found = np.empty((len(matrices), len(points), 3), np.float32)
    columns = points.T.astype(np.float64, order="C")
    for matrix, places in zip(matrices, found, strict=True):
        seen = matrix[:, :3] @ columns + matrix[:, 3:]  # coordinate by coordinate, which is quick
        if matrix[3, :3].any():
            seen /= seen[3]
        low, high = seen[:2].min(axis=1), seen[:2].max(axis=1)
        cell = float((high - low).max()) / (side - 2 * _MARGIN)
        shift = np.append(0.5 * side - 0.5 * (low + high) / cell, 0.0)
        matrix[:3] = matrix[:3] / cell + shift[:, None] * matrix[3]
        places[:] = (seen[:3] / cell + shift[:, None]).T
    return found


def _drawn(
    places: Float32, casters: Sequence[tuple[PosedMesh, Cutout]], side: int
) -> tuple[Float32, Float32]:
    """Maps (K, side, side) of meshes with vertices at places (K, V, 3), and each cell's highest."""
    count, cells = len(places), side // CELL
    nearness = np.empty((count, side, side), np.float32)
    highest = np.empty((count, cells, cells), np.float32)
    starts = np.cumsum([0, *(len(mesh.positions) for mesh, _ in casters)])
    edges = np.linspace(0, cells, min(cells, _BANDS * processors()) + 1).astype(int).tolist()

    def draw_band(band: tuple[int, int, int]) -> None:
        one, first, last = band
        rows = CELL * first, CELL * last
        nearness[one, slice(*rows)] = _NOTHING
        for (mesh, cutout), begin in zip(casters, starts, strict=False):
            own = places[one, begin : begin + len(mesh.positions)]
            kernels.draw_nearness(own, mesh.faces, cutout, *rows, nearness[one])
        kernels.highest_in_cells(nearness[one, slice(*rows)], highest[one, first:last])

    parallel_for(draw_band, [(one, *band) for one in range(count) for band in pairwise(edges)])
    return nearness, highest


def _spread(cells: Float32) -> Float32:
    """The highest nearness in and around each cell (K, cells, cells), from that in each."""
    reach = math.ceil((_SOFTEST * CELL * cells.shape[1] + 2) / CELL)
    around = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.stack([np.asarray(cv2.dilate(one, around), np.float32) for one in cells])


def side_for(posed: PosedScene, camera: Camera) -> int:
    """Width and height of maps whose pixels are as small as those of the object's picture [px].

    Args:
        posed: the object.
        camera: that takes it.
    """
    low, high = posed.bounds().astype(np.float64)
    size = float(np.linalg.norm(high - low))
    distance = float(np.linalg.norm(camera.world_from_camera[:3, 3] - 0.5 * (low + high)))
    seen = max(camera.fx, camera.fy) * size / max(distance, 0.5 * size, np.finfo(np.float64).tiny)
    wanted = min(max(seen, SIDES[0]), SIDES[1])
    step = (1 << math.floor(math.log2(wanted))) // _STEPS  # few, so that it seldom changes
    return step * math.ceil(wanted / step)
