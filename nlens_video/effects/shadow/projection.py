"""What a body hides from the ground before a camera: projections from many points of light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.effects.shadow.casters import Casters, ClippedMesh, Opacity
from nlens_video.effects.shadow.coverage import PROJECTIONS, mark_covered
from nlens_video.effects.shadow.transparency import absorb, no_absorption
from nlens_video.kernels.thread_pool import parallel_for
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Lamp

_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_R2 = (0.7548776662466927, 0.5698402909980532)  # of Roberts' low-discrepancy sequence
_NO_EDGES = np.zeros((0, 4), np.int32)
_LOOKED_AT = 400  # vertices whose shadows tell how fast all of them move
_LOWEST = 0.93  # squared sine off the vertical beyond which light from around is not followed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Pixels that a camera's ground is sampled at: a box of the frame, perhaps coarser than it.

    Attributes:
        box: where they lie; borders are multiples of the step, so that they lie on one grid
            wherever the box does [px].
        step: pixels of the frame that each stands for, each way [px].
    """

    box: Box
    step: int

    @classmethod
    def on(cls, box: Box, step: int) -> Grid:
        """The grid that holds a box of a frame."""
        low = Box(box.x0 // step, box.y0 // step, -(-box.x1 // step), -(-box.y1 // step))
        held = Box(low.x0 * step, low.y0 * step, low.x1 * step, low.y1 * step)
        return cls(box=held, step=step)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.box.height // self.step, self.box.width // self.step

    def view(self, camera: Camera) -> Camera:
        """What a camera of the frame sees on it."""
        step, (height, width) = self.step, self.shape
        return replace(
            camera,
            fx=camera.fx / step, fy=camera.fy / step,
            cx=(camera.cx - self.box.x0) / step, cy=(camera.cy - self.box.y0) / step,
            width=width, height=height,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class ShadowQuery:
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
class Moment:
    """What throws a shadow, and who sees it.

    Attributes:
        casters: what throws it.
        camera: the camera then.
    """

    casters: Casters
    camera: Camera


@dataclass(frozen=True, slots=True, eq=False)
class Occluder:
    """A body over a ground before a camera, at one moment.

    Attributes:
        camera: the camera.
        solid: the body, above the ground.
        veils: what of it is not opaque, above the ground, and how much light it stops.
        ground_y: height of the ground plane [scene unit].
        bounds: least and greatest coordinates of its vertices (2, 3) [scene unit].
    """

    camera: Camera
    solid: ClippedMesh
    veils: tuple[tuple[ClippedMesh, Opacity], ...]
    ground_y: float
    bounds: Float64

    @classmethod
    def of(cls, moment: Moment, ground_y: float) -> Occluder | None:
        """What of a moment's casters stands above the ground; None where nothing does."""
        casters = moment.casters
        solid = ClippedMesh.above(casters.vertices, casters.faces, casters.edges, ground_y)
        veils = tuple(
            (ClippedMesh.above(veil.vertices, veil.faces, _NO_EDGES, ground_y), veil.opacity)
            for veil in casters.veils
        )
        bodies = [body for body in (solid, *(veil for veil, _ in veils)) if len(body.faces)]
        if not bodies:
            return None
        points = np.concatenate([body.points for body in bodies])
        points = points[points[:, 1] >= ground_y]
        bounds = np.stack([points.min(axis=0), points.max(axis=0)])
        return cls(moment.camera, solid, veils, ground_y, bounds)

    def reached(self, lights: Float64, seen: Box) -> Box:
        """The part of a box of the frame in which the body can hide lights (N, 4)."""
        lights = lights[lights[:, 1] > lights[:, 3] * self.ground_y]
        if not len(lights):
            return Box(0, 0, 0, 0)
        corners = np.array([[*corner, 1.0] for corner in product(*self.bounds.T)])
        places = corners @ project_along_light(lights, self.ground_y, self.camera).swapaxes(
            1, 2
        )  # (N, 8, 3)
        beside = (lights[:, 3] > 0.0) & (lights[:, 1] <= self.bounds[1, 1])
        if beside.any() or (places[..., 2] <= 0.0).any():
            return seen
        columns, rows = places[..., 0] / places[..., 2], places[..., 1] / places[..., 2]
        return Box(
            math.floor(max(columns.min(), seen.x0)), math.floor(max(rows.min(), seen.y0)),
            math.ceil(min(columns.max(), seen.x1)), math.ceil(min(rows.max(), seen.y1)),
        )  # fmt: skip


def project_along_light(lights: Float64, ground_y: float, camera: Camera) -> Float64:
    """Where lights (N, 4) throw the world's points on the ground, and so on the screen.

    Homogeneous pixel positions (N, 3, 4), the last coordinate positive before the camera, for
    points that lie lower than the light.
    """
    plane = np.array([0.0, 1.0, 0.0, -ground_y])
    away = (lights @ plane)[:, None, None] * np.eye(4) - lights[:, :, None] * plane
    intrinsics = np.array(
        [[camera.fx, 0.0, -camera.cx], [0.0, -camera.fy, -camera.cy], [0.0, 0.0, -1.0]]
    )
    return np.asarray(intrinsics @ camera.camera_from_world[:3] @ away)


def shadow_places(moments: Sequence[Moment], lamps: Sequence[Lamp], ground_y: float) -> Float64:
    """Where the shadows of some vertices lie on the frame at some moments.

    Args:
        moments: of the same vertices.
        lamps: what throws the shadows, beside light from straight above.
        ground_y: height of the ground [scene unit].

    Returns:
        Columns and rows (len(moments), V, 2), of those that lie before the camera all the time
        [px].
    """
    some = [_some_points(moment.casters) for moment in moments]
    middle = some[len(some) // 2].mean(axis=0)
    below = np.array([[0.0, 1.0, 0.0, 0.0]])
    lights = np.concatenate([below, *(lamp_points(own, middle, 1) for own in lamps)])
    seen = np.array(
        [
            np.column_stack([points, np.ones(len(points))])
            @ project_along_light(lights, ground_y, moment.camera).swapaxes(1, 2)
            for points, moment in zip(some, moments, strict=True)
        ]
    ).reshape(len(moments), -1, 3)
    before = (seen[..., 2] > 0.0).all(axis=0)
    return np.asarray(seen[:, before, :2] / seen[:, before, 2:])


def _some_points(casters: Casters) -> Float64:
    """A few hundred vertices, evenly among all (V, 3)."""
    points = np.concatenate([casters.vertices, *(veil.vertices[:, :3] for veil in casters.veils)])
    return points[:: max(1, len(points) // _LOOKED_AT)]


def hidden_shares(
    stages: Sequence[Occluder | None], asked: Sequence[ShadowQuery], threads: int | None = None
) -> list[Float32]:
    """Which share of lights a body hides from each pixel's ground, for each that is asked.

    What is not opaque hides a part of a light. A body that moves is met by one light after the
    other at one moment after the other: so the mean over its moments costs no more than one.

    Args:
        stages: the body at one or more moments; None: it hides nothing then.
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
        done[part] = _counts(stages, asked[part[0]], part[1])

    parallel_for(count, work, threads)
    counts = [np.zeros(one.grid.shape, np.float32) for one in asked]
    for part in work:  # in this order, whichever was ready first
        counts[part[0]] += done[part]
    return [number / np.float32(one.count) for number, one in zip(counts, asked, strict=True)]


def _counts(stages: Sequence[Occluder | None], asked: ShadowQuery, first: int) -> Float32:
    """How many of some lights in a row, as many as an array of bits holds, are hidden."""
    height, width = asked.grid.shape
    bits = np.zeros((height, width), np.uint8)
    veiled = no_absorption(height, width)
    for bit, light in enumerate(asked.lights[first : first + PROJECTIONS]):
        number = first + bit
        stage = stages[number % len(stages)]
        if stage is None or light[1] <= light[3] * stage.ground_y:
            continue
        (matrix,) = project_along_light(light[None], stage.ground_y, asked.grid.view(stage.camera))
        at = (((number + 1) * _R2[0]) % 1.0, ((number + 1) * _R2[1]) % 1.0)
        solid = stage.solid if light[3] == 0.0 else stage.solid.below(light[1])
        mark_covered(bits, bit, (solid.vertices, solid.faces, solid.edges), matrix, at)
        for whole, opacity in stage.veils:
            veil = whole if light[3] == 0.0 else whole.below(light[1])
            points = veil.points @ matrix[:, :3].T + matrix[:, 3]
            surface = np.ascontiguousarray(veil.vertices[:, 3:])
            texture = (opacity.alpha, opacity.wrap, opacity.cutoff)
            call = number + 1
            absorb(veiled, (bits, bit), points, surface, veil.faces, texture, call, at)
    return np.bitwise_count(bits).astype(np.float32) + veiled.taken


def hemisphere(directions: int) -> Float64:
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
