"""The objects and lights of one glTF file, which may move as a whole in a scene of several."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.objects import Playback
from nlens_video.scene.gltf.animations import Animation
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import check_range
from nlens_video.scene.gltf.meshes import WITHOUT_NORMALS, TriangleMesh
from nlens_video.scene.gltf.nodes import Hierarchy, Skin
from nlens_video.scene.illumination import Light, PosedLight, pose_light
from nlens_video.scene.object_motion import ObjectMotion
from nlens_video.scene.posed import Carriers, Instance, PosedMesh

# A small file can place one mesh thousands of times; beyond this no frame would ever be drawn.
MAX_VERTICES = 5_000_000
# Distance from the world's origin, in extents of a scene, from which on float32 holds positions
# badly: to 1e-5 of the extent.
_FAR = 256.0
Moment = tuple[float, float]
"""Moments of a part's animation and of its motion as a whole [s]; equal ones show the same."""
Moved = tuple[Float64, dict[int, Float64]]
"""World matrices of all nodes (N, 4, 4); animated morph weights by node."""


class Hull(Struct, frozen=True, eq=False):
    """Boxes round all vertices, each carried by a node.

    Attributes:
        nodes: what carries each (B,).
        corners: in its space, homogeneous, as columns (B, 4, 8).
    """

    nodes: npt.NDArray[np.int64]
    corners: Float64

    @classmethod
    def of(cls, instances: Sequence[Instance], weights: dict[int, Float64]) -> Hull:
        """That of all instances, with animated morph weights by node."""
        boxes = [instance.boxes(weights.get(instance.node)) for instance in instances]
        return cls(
            np.array([node for nodes, _ in boxes for node in nodes], np.int64),
            np.concatenate([corners for _, corners in boxes]),
        )

    def at(self, world: Float64) -> Float64:
        """The corners in the world (8 B, 3), for world matrices of all nodes (N, 4, 4).

        Raises:
            SceneError: one lies beyond what float32 can multiply.
        """
        carried = world[self.nodes, :3] @ self.corners
        check_range(carried, "a vertex or a skin's joint")
        return np.swapaxes(carried, 1, 2).reshape(-1, 3)


@dataclass(slots=True)
class ScenePart:
    """What one file brings.

    Attributes:
        path: the file.
        playback: which of its animations play, and when.
        hierarchy: its nodes.
        animation: what plays of what moves meshes and lights; a loop is as long as that.
        instances: its meshes, where its nodes place them.
        lights: its lights with the nodes that carry them.
        node_names: names of all its nodes, possibly empty.
        motion: how the whole stands in a world that it shares; None where it is that world.
    """

    path: Path
    playback: Playback
    hierarchy: Hierarchy
    animation: Animation
    instances: tuple[Instance, ...]
    lights: tuple[tuple[int, Light], ...]
    node_names: tuple[str, ...]
    motion: ObjectMotion | None = None
    _hull: Hull | None = field(init=False, default=None)
    _resting_lights: tuple[PosedLight, ...] | None = field(init=False, default=None)
    _lights_rest: bool = field(init=False)

    def __post_init__(self) -> None:
        carriers = self.hierarchy.with_ancestors(node for node, _ in self.lights)
        still = not any(track.node in carriers for track in self.animation.tracks)
        self._lights_rest = still and (self.motion is None or not self.motion.moves)

    @property
    def moves(self) -> bool:
        """Whether anything in it changes with time."""
        return self.animation.duration_s > 0.0 or (self.motion is not None and self.motion.moves)

    @property
    def end_s(self) -> float:
        """Moment of the plate from which on it rests, or plays again what it played [s]."""
        played = self.playback
        offset_s = 0.0 if played.loop else played.offset_s
        own = max(0.0, (self.animation.duration_s - offset_s) / played.speed)
        return own if self.motion is None else max(own, self.motion.end_s)

    @property
    def vertices(self) -> int:
        """Vertices of all instances."""
        return sum(len(instance.geometry.positions) for instance in self.instances)

    def moment(self, time_s: float) -> Moment:
        """What tells how it stands at a moment of the plate [s]; the same wherever it rests."""
        duration_s = self.animation.duration_s
        played = self.playback.moment(time_s, duration_s)
        moves = self.motion is not None and self.motion.moves
        return min(max(played, 0.0), duration_s), time_s if moves else 0.0

    def jumps(self, start_s: float, end_s: float) -> list[float]:
        """Moments of the plate between two at which it may leave its place at once [s].

        They are those at which a loop begins anew and those of keys that change a value at once.
        """
        played, duration_s = self.playback, self.animation.duration_s
        start, end = (played.offset_s + played.speed * time_s for time_s in (start_s, end_s))
        moments = list(self.animation.steps)
        if played.loop and duration_s > 0.0:
            if end - start >= duration_s:
                return []  # the shutter sees all of it
            rounds = range(math.floor(start / duration_s), math.floor(end / duration_s) + 1)
            moments = [one * duration_s + key for one in rounds for key in (0.0, *moments)]
        return [(one - played.offset_s) / played.speed for one in moments if start < one < end]

    def moved(self, moment: Moment) -> Moved:
        """Its nodes in the world."""
        played, time_s = moment
        world = self.hierarchy.world(self._local(played))
        if self.motion is not None:
            world = self.motion.at(time_s) @ world
        return world, self.animation.weights(played)

    def meshes(self, moved: Moved, origin: Float64 | None = None) -> tuple[PosedMesh, ...]:
        """Its primitives as `moved` has them; `origin` is that of `PosedScene`."""
        carriers, weights = Carriers(moved[0]), moved[1]
        return tuple(one.place(carriers, weights.get(one.node), origin) for one in self.instances)

    def posed_lights(self, moment: Moment) -> tuple[PosedLight, ...]:
        """Its lights at a moment; the very same objects where none of them ever moves.

        A lamp whose file is scaled keeps its light on what stands around it there: intensity goes
        with the square of the distance.
        """
        if self._resting_lights is not None:
            return self._resting_lights
        lights = self._lights_at(moment)
        if self._lights_rest:
            self._resting_lights = lights
        return lights

    def _lights_at(self, moment: Moment) -> tuple[PosedLight, ...]:
        if not self.lights:
            return ()
        played, time_s = moment
        world, scale = self.hierarchy.oriented(self._local(played)), 1.0
        if self.motion is not None:
            world = self.motion.at(time_s) @ world
            scale = float(self.motion.scale.at(time_s)[0])
        return tuple(
            self._posed_light(node, light if scale == 1.0 else _scaled(light, scale), world[node])
            for node, light in self.lights
        )

    def _posed_light(self, node: int, light: Light, world: Float64) -> PosedLight:
        try:
            return pose_light(light, world)
        except SceneError as error:
            named = self.node_names[node] or f"nodes[{node}]"
            raise SceneError(f"{self.path}: light '{named}': {error}") from error

    def _local(self, played: float) -> Float64:
        """Translation, rotation and scale of its nodes at a moment of its animation (N, 10)."""
        return self.animation.apply(self.hierarchy.rest, played)

    def hull(self, moved: Moved) -> Float64:
        """Points (N, 3) whose convex hull holds all triangles; see `Scene.hull`."""
        world, weights = moved
        if self._hull is None or self.animation.morphs:
            self._hull = Hull.of(self.instances, weights)
        return self._hull.at(world)

    def carried_by(self, name: str) -> frozenset[int]:
        """The nodes of a name, and all that they carry."""
        named = (index for index, own in enumerate(self.node_names) if own == name)
        return self.hierarchy.with_descendants(named)

    def drawn_names(self) -> Iterable[str]:
        """Names of nodes that carry a mesh."""
        names = dict.fromkeys(self.node_names[instance.node] for instance in self.instances)
        return (name for name in names if name)


def far_origin(parts: Sequence[ScenePart], hull: Callable[[float], Float64]) -> Float64 | None:
    """The `origin` of a `PosedScene`, the same at all times.

    Args:
        parts: of the scene.
        hull: as `Scene.hull`.
    """
    end_s = max(part.animation.duration_s for part in parts)
    points = np.concatenate([hull(share * end_s) for share in (0.0, 0.5, 1.0)])
    if not len(points):  # skins whose joints carry nothing
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    extent, middle = float((high - low).max()), 0.5 * (low + high)
    if not float(np.abs(middle).max()) > _FAR * extent > 0.0:
        return None
    # a float32: what the file holds as such differs from it exactly
    return np.asarray(middle.astype(np.float32).astype(np.float64))


def carriers(
    hierarchy: Hierarchy, instances: Iterable[Instance], lights: Iterable[tuple[int, Light]]
) -> frozenset[int]:
    """Nodes that carry meshes and lights, those of their joints included."""
    nodes = {node for node, _ in lights}
    for one in instances:
        nodes.update((one.node, *(() if one.skin is None else one.skin.joints)))
    return hierarchy.with_ancestors(nodes)


def _scaled(light: Light, scale: float) -> Light:
    if light.kind == "directional":
        return light
    reach = None if light.range is None else scale * light.range
    return replace(light.scaled(scale * scale), range=reach)


def read_instances(
    document: Document,
    hierarchy: Hierarchy,
    meshes: tuple[TriangleMesh, ...],
    skins: tuple[Skin, ...],
) -> tuple[Instance, ...]:
    """The meshes of a file where its nodes place them that are drawn.

    Raises:
        SceneError: there is none, or too much of it.
    """
    found: list[Instance] = []
    vertices = 0
    for index, node in enumerate(document.items("nodes")):
        number = node.reference("mesh", len(meshes))
        skin = node.reference("skin", len(skins))
        if number is None or index not in hierarchy.drawn:
            continue
        mesh = meshes[number]
        vertices += sum(len(geometry.positions) for geometry in mesh.geometries)
        if vertices > MAX_VERTICES:
            flat = any(geometry.flat for mesh in meshes for geometry in mesh.geometries)
            raise SceneError(
                f"more than {MAX_VERTICES} vertices in all its nodes; simplify the scene"
                f"{f', or {WITHOUT_NORMALS}' if flat else ''}"
            )
        weights = node.numbers("weights") or mesh.weights
        for geometry in mesh.geometries:
            targets = 0 if geometry.targets is None else len(geometry.targets)
            rest = np.array((*weights, *np.zeros(targets))[:targets])
            found.append(Instance(geometry, index, None if skin is None else skins[skin], rest))
    if not found:
        hidden = " (KHR_node_visibility hides some)" if hierarchy.drawn < hierarchy.visible else ""
        raise SceneError(f"no triangles in its scene{hidden}; expected an object to draw")
    return tuple(found)
