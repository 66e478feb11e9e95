"""What a body hides from the ground before a camera: projections from many points of light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from nlens_video.frames import Box, Float32, Float64
from nlens_video.kernels.cast import PROJECTIONS, mark_covered
from nlens_video.kernels.cast_veils import count_veiled, new_veiled
from nlens_video.kernels.pool import share
from nlens_video.scene.camera import Camera
from nlens_video.scene.casters import Casters, Opacity
from nlens_video.scene.illumination import Lamp
from nlens_video.scene.solid import Solid

_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_R2 = (0.7548776662466927, 0.5698402909980532)  # of Roberts' low-discrepancy sequence
_NO_EDGES = np.zeros((0, 4), np.int32)
_LOWEST = 0.93  # squared sine off the vertical beyond which light from around is not followed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Pixels that a camera's ground is sampled at: a box of the frame, perhaps coarser than it.

    Attributes:
        box: where they lie; borders are multiples of the step, so that they lie on one grid
            wherever the box does [px].
        step: pixels of the frame that each stands for, each way [px].
        camera: the view on them.
    """

    box: Box
    step: int
    camera: Camera

    @classmethod
    def on(cls, camera: Camera, box: Box, step: int) -> Grid:
        """The grid that holds a box of a camera's frame."""
        low = Box(box.x0 // step, box.y0 // step, -(-box.x1 // step), -(-box.y1 // step))
        held = Box(low.x0 * step, low.y0 * step, low.x1 * step, low.y1 * step)
        view = replace(
            camera,
            fx=camera.fx / step, fy=camera.fy / step,
            cx=camera.cx / step - low.x0, cy=camera.cy / step - low.y0,
            width=low.width, height=low.height,
        )  # fmt: skip
        return cls(box=held, step=step, camera=view)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.camera.height, self.camera.width


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """What is to be found: which part of some lights is hidden from each pixel's ground.

    Attributes:
        lights: points (x, y, z, 1), or directions towards what is far away (x, y, z, 0) (N, 4).
        count: how many they stand for [1].
        grid: the pixels.
    """

    lights: Float64
    count: int
    grid: Grid


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A body over a ground.

    Attributes:
        solid: the body, above the ground.
        veils: what of it is not opaque, above the ground, and how much light it stops.
        ground_y: height of the ground plane [scene unit].
        bounds: least and greatest coordinates of the body (2, 3) [scene unit].
    """

    solid: Solid
    veils: tuple[tuple[Solid, Opacity], ...]
    ground_y: float
    bounds: Float64

    @classmethod
    def of(cls, casters: Casters, ground_y: float) -> Stage | None:
        """What of some casters stands above the ground; None where nothing does."""
        solid = Solid.above(casters.vertices, casters.faces, casters.edges, ground_y)
        veils = tuple(
            (Solid.above(veil.vertices, veil.faces, _NO_EDGES, ground_y), veil.opacity)
            for veil in casters.veils
        )
        found = [body.bounds for body in (solid, *(veil for veil, _ in veils)) if len(body.faces)]
        if not found:
            return None
        low, high = np.min(found, axis=0)[0], np.max(found, axis=0)[1]
        return cls(solid, veils, ground_y, np.stack([low, high]))

    def reached(self, lights: Float64, camera: Camera, seen: Box) -> Box:
        """The part of a box of the frame in which the body can hide lights (N, 4)."""
        lights = lights[lights[:, 1] > lights[:, 3] * self.ground_y]
        if not len(lights):
            return Box(0, 0, 0, 0)
        corners = np.array([[*corner, 1.0] for corner in product(*self.bounds.T)])
        places = corners @ self._matrices(lights, camera).swapaxes(1, 2)  # (N, 8, 3)
        beside = (lights[:, 3] > 0.0) & (lights[:, 1] <= self.bounds[1, 1])
        if beside.any() or (places[..., 2] <= 0.0).any():
            return seen
        columns, rows = places[..., 0] / places[..., 2], places[..., 1] / places[..., 2]
        return Box(
            math.floor(max(columns.min(), seen.x0)), math.floor(max(rows.min(), seen.y0)),
            math.ceil(min(columns.max(), seen.x1)), math.ceil(min(rows.max(), seen.y1)),
        )  # fmt: skip

    def hidden(self, asked: Sequence[Asked], threads: int | None = None) -> list[Float32]:
        """Which share of lights the body hides from each pixel's ground, for each that is asked.

        What is not opaque hides a part of one.

        Args:
            asked: lights and pixels.
            threads: how many share the work at most; default: one a processor.
        """
        work = [
            (number, first)
            for number, one in enumerate(asked)
            for first in range(0, len(one.lights), PROJECTIONS)
        ]
        done: dict[tuple[int, int], Float32] = {}

        def count(part: tuple[int, int]) -> None:
            done[part] = self._counts(asked[part[0]], part[1])

        share(count, work, threads)
        counts = [np.zeros(one.grid.shape, np.float32) for one in asked]
        for part in work:  # in this order, whichever was ready first
            counts[part[0]] += done[part]
        return [number / np.float32(one.count) for number, one in zip(counts, asked, strict=True)]

    def _counts(self, asked: Asked, first: int) -> Float32:
        """How many of some lights in a row, as many as an array of bits holds, are hidden."""
        height, width = asked.grid.shape
        bits = np.zeros((height, width), np.uint8)
        veiled = new_veiled(height, width) if self.veils else None
        lights = asked.lights[first : first + PROJECTIONS]
        matrices = self._matrices(lights, asked.grid.camera)
        for bit, (light, matrix) in enumerate(zip(lights, matrices, strict=True)):
            if light[1] <= light[3] * self.ground_y:
                continue
            call = first + bit + 1
            at = ((call * _R2[0]) % 1.0, (call * _R2[1]) % 1.0)
            solid = self.solid if light[3] == 0.0 else self.solid.below(light[1])
            mesh = solid.vertices, solid.faces, solid.edges
            mark_covered(bits, bit, mesh, matrix, at)
            if veiled is None:
                continue
            for whole, opacity in self.veils:
                veil = whole if light[3] == 0.0 else whole.below(light[1])
                points = veil.points @ matrix[:, :3].T + matrix[:, 3]
                surface = np.ascontiguousarray(veil.vertices[:, 3:])
                texture = (opacity.alpha, opacity.wrap, opacity.cutoff)
                count_veiled(veiled, (bits, bit), points, surface, veil.faces, texture, call, at)
        counts = np.bitwise_count(bits).astype(np.float32)
        return counts if veiled is None else counts + veiled.taken

    def _matrices(self, lights: Float64, camera: Camera) -> Float64:
        """Where lights (N, 4) throw the world's points on the ground and so on the screen.

        Homogeneous pixel positions (N, 3, 4), the last coordinate positive before the camera, for
        points that lie lower than the light.
        """
        plane = np.array([0.0, 1.0, 0.0, -self.ground_y])
        away = (lights @ plane)[:, None, None] * np.eye(4) - lights[:, :, None] * plane
        intrinsics = np.array(
            [[camera.fx, 0.0, -camera.cx], [0.0, -camera.fy, -camera.cy], [0.0, 0.0, -1.0]]
        )
        return np.asarray(intrinsics @ camera.camera_from_world[:3] @ away)


def around(directions: int) -> Float64:
    """Directions (N, 4) to light from around, as many on a piece of the ground's cosine each.

    Those nearest to the horizon, which reach far and weigh little, are left out.

    Args:
        directions: how many there are with them.
    """
    number = np.arange(directions)
    squared_sine = (number + 0.5) / directions  # of the angle off the vertical
    turn, sine = number * _GOLDEN, np.sqrt(squared_sine)
    up = np.sqrt(1.0 - squared_sine)
    toward = np.stack([sine * np.cos(turn), up, sine * np.sin(turn), 0.0 * up], axis=1)
    return np.asarray(toward[squared_sine <= _LOWEST])


def lamp_points(lamp: Lamp, middle: Float64, count: int) -> Float64:
    """Points (N, 4) of a lamp's disc as seen from the object; w = 0 for a lamp far away."""
    posed = lamp.posed
    far = posed.light.kind == "directional"
    toward = -posed.direction if far else posed.position - middle
    distance = float(np.linalg.norm(toward))
    axis = toward / max(distance, np.finfo(np.float64).tiny)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    number = np.arange(count)
    radius = math.tan(0.5 * lamp.diameter) * distance * np.sqrt((number + 0.5) / count)
    aside = np.cos(number * _GOLDEN)[:, None] * first + np.sin(number * _GOLDEN)[:, None] * second
    middle_of_lamp = toward if far else posed.position
    places = middle_of_lamp + radius[:, None] * aside
    return np.column_stack([places, np.full(count, 0.0 if far else 1.0)])
