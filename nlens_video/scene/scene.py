"""The virtual scene: a glTF file, its camera, triangles and lights at any time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from nlens_video.core.errors import MissingCameraError, Note, NoteKind, SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.settings import ONCE, Playback
from nlens_video.scene.camera import Camera, Perspective, read_cameras, rigid
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.animation_reader import read_animations
from nlens_video.scene.gltf.animations import Animation, Animations, listed
from nlens_video.scene.gltf.document import Document, read_document
from nlens_video.scene.gltf.materials import read_materials
from nlens_video.scene.gltf.meshes import TriangleMesh, read_meshes
from nlens_video.scene.gltf.nodes import Hierarchy, Skin, read_hierarchy, read_skins
from nlens_video.scene.illumination import Light, pose_light, read_lights
from nlens_video.scene.posed import Hull, Instance, PosedScene

# A small file can place one mesh thousands of times; beyond this no frame would ever be drawn.
MAX_VERTICES = 5_000_000
_MOMENTS = 4  # kept: the frame's own, and the shutter opening and closing
_Moved = tuple[Float64, dict[int, Float64]]  # world matrices of nodes; animated morph weights


@dataclass(slots=True)
class Scene:
    """A loaded scene. It holds all of the file; posing it allocates only the posed vertices.

    Attributes:
        path: where it came from.
    """

    path: Path
    _playback: Playback
    _hierarchy: Hierarchy
    _animation: Animation
    _camera_motion: Animation
    _instances: tuple[Instance, ...]
    _cameras: tuple[Perspective, ...]
    _lights: tuple[tuple[int, Light], ...]
    _node_names: tuple[str, ...]
    _warnings: list[str] = field(default_factory=list)
    _hull: Hull | None = field(init=False, default=None)
    _moved: Callable[[float], _Moved] = field(init=False)
    _posed: Callable[[float], PosedScene] = field(init=False)
    _resting: dict[tuple[int, int, str | None, float], Camera] = field(
        init=False, default_factory=dict
    )  # the last camera, kept where it does not move

    def __post_init__(self) -> None:
        self._moved = lru_cache(_MOMENTS)(self._move)
        self._posed = lru_cache(_MOMENTS)(self._pose)

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
        meshes = read_meshes(document, accessors, read_materials(document))
        instances = _instances(document, hierarchy, meshes, read_skins(document, accessors))
        morphs = {i.node: len(i.weights) for i in instances}
        animations = read_animations(document, accessors, hierarchy, morphs)
        _name_alternatives(document, animations, playback)
        cameras = read_cameras(document, hierarchy.visible)
        return cls(
            path,
            playback,
            hierarchy,
            animations.chosen(playback.animation),
            animations.of_cameras(hierarchy.with_ancestors(camera.node for camera in cameras)),
            instances,
            cameras,
            tuple((n, light) for n, light in read_lights(document) if n in hierarchy.visible),
            tuple(node.name for node in document.items("nodes")),
            document.warnings,
        )

    @property
    def duration_s(self) -> float:
        """Time of the last key of the animation, 0 where nothing moves [s]."""
        return self._animation.duration_s

    @property
    def moves(self) -> bool:
        """Whether anything in it, the camera included, changes with time."""
        return max(self._animation.duration_s, self._camera_motion.duration_s) > 0.0

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
        return len(self._lights)

    def triangles(self, time_s: float, node: str | None = None) -> Float64:
        """World-space triangles (T, 3, 3) at a moment of the plate [scene unit].

        Args:
            time_s: moment of the plate [s].
            node: name of a node; only it and what it carries. None for all.

        Raises:
            SceneError: no such node carries a mesh.
        """
        carried = self._carried_by(node) if node is not None else None
        parts = [
            mesh.positions.astype(np.float64)[mesh.faces]
            for instance, mesh in zip(self._instances, self.pose(time_s).meshes, strict=True)
            if carried is None or instance.node in carried
        ]
        if not parts:
            drawn = dict.fromkeys(self._node_names[instance.node] for instance in self._instances)
            known = listed([name for name in drawn if name])
            there = f"expected one of {known}" if known else "its objects have no names"
            raise SceneError(f"{self.path}: no object is named '{node}'; {there}")
        return np.concatenate(parts)

    def _carried_by(self, name: str) -> frozenset[int]:
        named = (index for index, own in enumerate(self._node_names) if own == name)
        return self._hierarchy.with_descendants(named)

    def hull(self, time_s: float) -> Float64:
        """Points (N, 3) whose convex hull holds all triangles at a moment; cheaper than `pose`.

        Unless it `morphs`, a vertex is the same mean of them at all moments.
        """
        world, weights = self._moved(time_s)
        if self._hull is None or self.morphs:
            self._hull = Hull.of(self._instances, weights)
        return self._hull.at(world)

    @property
    def morphs(self) -> bool:
        """Whether morph weights are animated."""
        return self._animation.morphs

    def _move(self, time_s: float) -> _Moved:
        moment = self._playback.moment(time_s, self._animation.duration_s)
        world = self._hierarchy.world(self._animation.apply(self._hierarchy.rest, moment))
        return world, self._animation.weights(moment)

    def pose(self, time_s: float) -> PosedScene:
        """Triangles and lights at a moment of the plate [s].

        Before the first key of an animation they rest, and after its last unless it loops.
        """
        return self._posed(time_s)

    def _pose(self, time_s: float) -> PosedScene:
        world, weights = self._moved(time_s)
        meshes = tuple(i.place(world, weights.get(i.node)) for i in self._instances)
        lights = tuple(pose_light(light, world[node]) for node, light in self._lights)
        return PosedScene(time_s, meshes, lights)

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
        if not self._camera_motion.tracks and key in self._resting:
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
        try:
            moved = self._camera_motion.apply(self._hierarchy.rest, time_s)
            pose = rigid(self._hierarchy.world(moved)[chosen.node])
            yfov = chosen.yfov_at(self._camera_motion, time_s)
        except SceneError as error:
            raise SceneError(f"{self.path}: camera '{chosen.name}': {error}") from error
        self._resting = {key: Camera.from_yfov(pose, yfov, width, height, pixel_aspect)}
        return self._resting[key]

    def zoom_ends(self, name: str | None = None) -> tuple[float, ...]:
        """Times of a camera's narrowest and widest keys [s], none where its lens stays.

        Raises:
            SceneError: the file has no such camera.
        """
        return self._camera_motion.zoom_ends(self._camera(name).number)

    def _camera(self, name: str | None) -> Perspective:
        if not self._cameras:
            raise MissingCameraError(
                f"{self.path}: no perspective camera; give the plate's by --camera-from CAMERA "
                "(`nlens-video solve` finds it), or place the object with --at X,Y --size S "
                "--yaw D --horizon H (`nlens-video place` shows choices), or "
                "add one in the modelling program and export it"
            )
        if name is None:
            return self._cameras[0]
        for camera in self._cameras:
            if name in (camera.name, camera.node_name):
                return camera
        known = ", ".join(named for named in self.camera_names if named)
        there = f"expected one of {known}" if known else "its cameras have no names"
        raise SceneError(f"{self.path}: no camera is named '{name}'; {there}")


def _name_alternatives(document: Document, animations: Animations, playback: Playback) -> None:
    left_out = animations.left_out(playback.animation)
    if left_out:
        played = animations.played()
        document.warn(
            f"{listed(played)} {'plays' if len(played) == 1 else 'play'}; {listed(left_out, 4)} "
            "would move the same parts: choose with --animation NAME"
        )


def _instances(
    document: Document,
    hierarchy: Hierarchy,
    meshes: tuple[TriangleMesh, ...],
    skins: tuple[Skin, ...],
) -> tuple[Instance, ...]:
    found: list[Instance] = []
    vertices = 0
    for index, node in enumerate(document.items("nodes")):
        number = node.reference("mesh", len(meshes))
        skin = node.reference("skin", len(skins))
        if number is None or index not in hierarchy.visible:
            continue
        mesh = meshes[number]
        vertices += sum(len(geometry.positions) for geometry in mesh.geometries)
        if vertices > MAX_VERTICES:
            raise SceneError(
                f"more than {MAX_VERTICES} vertices after instancing; simplify the scene"
            )
        weights = node.numbers("weights") or mesh.weights
        for geometry in mesh.geometries:
            targets = 0 if geometry.targets is None else len(geometry.targets)
            rest = np.array((*weights, *np.zeros(targets))[:targets])
            found.append(Instance(geometry, index, None if skin is None else skins[skin], rest))
    if not found:
        raise SceneError("no triangles in its scene; expected an object to draw")
    return tuple(found)
