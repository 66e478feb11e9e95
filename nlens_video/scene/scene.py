"""The virtual scene: glTF files, their camera, triangles and lights at any time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace  # noqa: TID251 - scenes are dataclasses
from functools import lru_cache
from itertools import chain
from pathlib import Path

import numpy as np

from nlens_video.core.errors import Note, NoteKind, SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.objects import ONCE, Playback
from nlens_video.scene.camera import Camera, Perspective, chosen_camera, read_cameras, rigid
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.animation_reader import read_animations
from nlens_video.scene.gltf.animations import Animation, listed
from nlens_video.scene.gltf.document import Document, read_document
from nlens_video.scene.gltf.materials import read_materials
from nlens_video.scene.gltf.meshes import read_meshes
from nlens_video.scene.gltf.nodes import Hierarchy, read_hierarchy, read_skins
from nlens_video.scene.illumination import PosedLight, read_lights
from nlens_video.scene.object_motion import ObjectMotion
from nlens_video.scene.posed import PosedMesh, PosedScene
from nlens_video.scene.scene_part import (
    MAX_VERTICES,
    Moment,
    Moved,
    ScenePart,
    carriers,
    far_origin,
    read_instances,
)
from nlens_video.scene.welding import without_strays

_MOMENTS = 6  # kept: the frame's own, the shutter opening and closing, samples between them
_Moments = tuple[Moment, ...]
_Posed = tuple[tuple[PosedMesh, ...], tuple[PosedLight, ...]]


@dataclass(slots=True)
class Scene:
    """Loaded files. It holds all of them; posing it allocates only the posed vertices.

    Attributes:
        parts: what each file brings; the world and the cameras are those of the first.
        camera_motion: what moves and zooms the cameras, at the plate's own time.
    """

    parts: tuple[ScenePart, ...]
    _hierarchy: Hierarchy
    camera_motion: Animation
    _cameras: tuple[Perspective, ...]
    _warnings: list[str] = field(default_factory=list)
    _moved: Callable[[_Moments], tuple[Moved, ...]] = field(init=False)
    _hull: Callable[[_Moments], Float64] = field(init=False)
    _posed: Callable[[_Moments], _Posed] = field(init=False)
    _origin: Callable[[], Float64 | None] = field(init=False)
    _resting: dict[tuple[int, int, str | None, float], Camera] = field(
        init=False, default_factory=dict
    )  # the last camera, kept where it does not move

    def __post_init__(self) -> None:
        self._moved = lru_cache(_MOMENTS)(self._move)
        self._hull = lru_cache(_MOMENTS)(self._find_hull)
        self._posed = lru_cache(_MOMENTS)(self._pose)
        self._origin = lru_cache(1)(lambda: far_origin(self.parts, self.hull))

    @classmethod
    def load(cls, path: Path, playback: Playback = ONCE, scene: str | None = None) -> Scene:
        """Read a `.glb` or `.gltf` file.

        Args:
            path: the file.
            playback: which of its animations play, and when.
            scene: name of its scene, else its number from 0; None for the file's default.

        Raises:
            SceneError: not readable, damaged, without a triangle, without the animation, or in
                need of an extension that is not supported.
        """
        try:
            return cls._assemble(path, read_document(path), playback, scene)
        except SceneError as error:
            raise SceneError(f"{path}: {error}") from error

    @classmethod
    def _assemble(
        cls, path: Path, document: Document, playback: Playback, scene: str | None
    ) -> Scene:
        accessors = AccessorReader(document)
        hierarchy = read_hierarchy(document, scene)
        read = read_meshes(document, accessors, read_materials(document))
        meshes = tuple(without_strays(mesh, document) for mesh in read)
        instances = read_instances(document, hierarchy, meshes, read_skins(document, accessors))
        morphs = {i.node: len(i.weights) for i in instances}
        animations = read_animations(document, accessors, hierarchy, morphs)
        animations.name_alternatives(document, playback.animation)
        cameras = read_cameras(document, hierarchy.visible)
        lights = tuple((n, light) for n, light in read_lights(document) if n in hierarchy.drawn)
        part = ScenePart(
            path,
            playback,
            hierarchy,
            animations.of_objects(carriers(hierarchy, instances, lights), playback.animation),
            instances,
            lights,
            tuple(node.name for node in document.items("nodes")),
        )
        carrying = hierarchy.with_ancestors(camera.node for camera in cameras)
        moves = animations.of_cameras(carrying, playback.animation)
        return cls((part,), hierarchy, moves, cameras, document.warnings)

    def joined(self, others: Sequence[Scene]) -> Scene:
        """One scene of this one's files and those of others, in this one's world.

        Raises:
            SceneError: too much for one picture.
        """
        if not others:
            return self
        parts = (*self.parts, *(part for other in others for part in other.parts))
        if sum(part.vertices for part in parts) > MAX_VERTICES:
            raise SceneError(
                f"more than {MAX_VERTICES} vertices in all objects; simplify their files"
            )
        lines = [line for scene in (self, *others) for line in scene._warnings]
        return replace(self, parts=parts, _warnings=list(dict.fromkeys(lines)))

    def only(self, number: int) -> Scene:
        """What one of the files brings, as it has it."""
        part = self.parts[number]
        if self.parts == (part,) and part.motion is None:
            return self
        return replace(self, parts=(replace(part, motion=None),))

    def with_motions(self, motions: Sequence[ObjectMotion | None]) -> Scene:
        """The same files, each standing or moving as a whole; None: as the file has it."""
        pairs = zip(self.parts, motions, strict=True)
        return replace(self, parts=tuple(replace(part, motion=one) for part, one in pairs))

    @property
    def path(self) -> Path:
        """The first file."""
        return self.parts[0].path

    @property
    def moves(self) -> bool:
        """Whether anything in it, the camera included, changes with time."""
        return self.camera_motion.duration_s > 0.0 or any(part.moves for part in self.parts)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the file has that is not drawn or does not fit, one line each."""
        return tuple(self._warnings)

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the perspective cameras, in the file's order."""
        return tuple(camera.name for camera in self._cameras)

    @property
    def light_count(self) -> int:
        """Punctual lights of the scene."""
        return sum(len(part.lights) for part in self.parts)

    def triangles(self, time_s: float, node: str | None = None) -> Float64:
        """World-space triangles (T, 3, 3) at a moment of the plate [scene unit].

        Without those that are scaled to 0, unless all are.

        Args:
            time_s: moment of the plate [s].
            node: name of a node; only it and what it carries. None for all.

        Raises:
            SceneError: no such node carries a mesh.
        """
        drawn: list[Float64] = []
        hidden: list[Float64] = []
        origin = self._origin()
        for part, moved in zip(self.parts, self._moved(self._moments(time_s)), strict=True):
            carried = None if node is None else part.carried_by(node)
            for instance, mesh in zip(part.instances, part.meshes(moved, origin), strict=True):
                if carried is None or instance.node in carried:
                    (drawn if mesh.drawn else hidden).append(mesh.exact(origin)[mesh.faces])
        if not (drawn or hidden):
            known = listed([name for part in self.parts for name in part.drawn_names()])
            there = f"expected one of {known}" if known else "its objects have no names"
            raise SceneError(f"{self.path}: no object is named '{node}'; {there}")
        return np.concatenate(drawn or hidden)

    def hull(self, time_s: float) -> Float64:
        """Points (N, 3) whose convex hull holds all triangles at a moment; cheaper than `pose`.

        Unless it `morphs`, a vertex is the same mean of them at all moments.
        """
        return self._hull(self._moments(time_s))

    def jumps(self, start_s: float, end_s: float) -> list[float]:
        """Moments of the plate between two at which something may leave its place at once [s]."""
        steps = [time_s for time_s in self.camera_motion.steps if start_s < time_s < end_s]
        return steps + [time_s for part in self.parts for time_s in part.jumps(start_s, end_s)]

    @property
    def morphs(self) -> bool:
        """Whether morph weights are animated."""
        return any(part.animation.morphs for part in self.parts)

    def _moments(self, time_s: float) -> _Moments:
        return tuple(part.moment(time_s) for part in self.parts)

    def _move(self, moments: _Moments) -> tuple[Moved, ...]:
        return tuple(part.moved(one) for part, one in zip(self.parts, moments, strict=True))

    def _find_hull(self, moments: _Moments) -> Float64:
        moved = zip(self.parts, self._moved(moments), strict=True)
        return np.concatenate([part.hull(one) for part, one in moved])

    def pose(self, time_s: float) -> PosedScene:
        """Triangles and lights at a moment of the plate [s].

        Before the first key of an animation they rest, and after its last unless it loops.
        """
        return PosedScene(time_s, *self._posed(self._moments(time_s)), self._origin())

    def _pose(self, moments: _Moments) -> _Posed:
        origin = self._origin()
        standing = zip(self.parts, self._moved(moments), strict=True)
        meshes = tuple(mesh for part, moved in standing for mesh in part.meshes(moved, origin))
        lights = (part.posed_lights(one) for part, one in zip(self.parts, moments, strict=True))
        return meshes, tuple(chain.from_iterable(lights))

    def camera(
        self,
        time_s: float,
        width: int,
        height: int,
        name: str | None = None,
        pixel_aspect: float = 1.0,
    ) -> Camera:
        """The virtual camera at a time, on a frame of a size.

        It moves and zooms as the file has it, at the plate's own time, whatever the object's
        animation does.
        The vertical field of view is the file's; a camera made for another aspect ratio is
        reported in `warnings`.

        Args:
            time_s: time [s].
            width: columns of the frame [px].
            height: rows of the frame [px].
            name: which camera; the first by default.
            pixel_aspect: width of a pixel by its height [1].

        Raises:
            SceneError: the file has no such camera, its node has no extent, or its field of view
                no angle.
        """
        key = (width, height, name, pixel_aspect)
        if not self.camera_motion.tracks and key in self._resting:
            return self._resting[key]
        chosen = self._camera(name)
        aspect = width * pixel_aspect / height
        if chosen.aspect_ratio is not None and abs(chosen.aspect_ratio / aspect - 1.0) > 0.01:
            line = Note(
                f"camera '{chosen.name}' was made for an aspect ratio of "
                f"{chosen.aspect_ratio:.4g}, the frame has {aspect:.4g}; "
                "its vertical field of view is kept",
                NoteKind.CAMERA,
            )
            if line not in self._warnings:
                self._warnings.append(line)
        moved = self.camera_motion.apply(self._hierarchy.rest, time_s)
        try:
            world = self._hierarchy.oriented(moved)
        except SceneError as error:  # of any node
            raise SceneError(f"{self.path}: {error}") from error
        try:
            pose = rigid(world[chosen.node])
            yfov = chosen.yfov_at(self.camera_motion, time_s)
        except SceneError as error:
            raise SceneError(f"{self.path}: camera '{chosen.name}': {error}") from error
        self._resting = {key: Camera.from_yfov(pose, yfov, width, height, pixel_aspect)}
        return self._resting[key]

    def zoom_ends(self, name: str | None = None) -> tuple[float, ...]:
        """Times of a camera's narrowest and widest keys [s], none where its lens stays.

        Raises:
            SceneError: the file has no such camera.
        """
        return self.camera_motion.zoom_ends(self._camera(name).number)

    def _camera(self, name: str | None) -> Perspective:
        return chosen_camera(self._cameras, name, self.path)
