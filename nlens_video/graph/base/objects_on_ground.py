"""Several objects, and objects that move by keys, on the ground of the first one's world.

The first object stands in its file's world as it always does: the camera is moved to suit it. The
others, and what is keyed, are moved in that world: a file as a whole is turned about the vertical,
scaled and put on the ground where the camera of that moment sees it at its place in the frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.placed import ground_seen_at
from nlens_video.cameras.placement import contact_depth, contact_point
from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.layers import Float32, Float64
from nlens_video.core.objects import FurtherObject, PlaceKey, PlaceKeys
from nlens_video.core.placement import GroundPlacing, Placement
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.view import View, choose_camera
from nlens_video.scene.camera import Camera
from nlens_video.scene.object_motion import Curve, ObjectMotion, turn_about_up
from nlens_video.scene.scene import Scene


class Staged(Struct, frozen=True, kw_only=True):
    """A scene whose objects stand and move as they are placed, and the camera that sees them.

    Attributes:
        objects: the settings; where there are several objects, or keys, with the ground's height.
        scene: the files in the world of the first.
        view: with the camera.
        notes: for the user.
    """

    objects: ObjectSettings
    scene: Scene
    view: View
    notes: tuple[str, ...]


def load_scene(objects: ObjectSettings) -> Scene:
    """The files of all objects, each as it has them; `stage` places them.

    Raises:
        SceneError: as `Scene.load`, or too much for one picture.
    """
    first = Scene.load(objects.glb, objects.playback, objects.scene)
    others = [Scene.load(one.glb, one.playback, one.scene) for one in objects.others]
    return first.joined(others)


def is_placed(objects: ObjectSettings, first: Scene) -> bool:
    """Whether the first object is put at a place of the plate, not seen as its file has it."""
    return bool(objects.placing or objects.on_ground or not first.camera_names)


def stage(objects: ObjectSettings, scene: Scene, view: View) -> Staged:
    """Choose the camera and place the objects.

    Args:
        objects: the objects.
        scene: their files, from `load_scene`, or as they were staged before.
        view: the frame, with the plate's solved camera if there is one.

    Raises:
        SceneError: no camera sees them so, or the first file has none.
        UsageError: an object is not placed, or its place makes no sense.
    """
    first = scene.only(0)
    if not (objects.keys or objects.others):
        view, notes = choose_camera(objects, first, view)
        return Staged(objects=objects, scene=first, view=view, notes=notes)
    if objects.layers is not None:
        raise UsageError("--layers hold one object as it was rendered; leave keys and others out")
    anchors = [_time_of_key(key, view) for key in objects.keys.of("at")[:1]]
    view, notes = choose_camera(objects, first, view, anchors[0] if anchors else None)
    vertices = first.pose(0.0).vertices()
    contact = contact_point(vertices, objects.ground_y)
    ground = _Ground(first, view, float(contact[1]))
    motions: list[ObjectMotion | None] = [None]
    if objects.keys:
        standing = _Standing(objects.glb, vertices, contact, ground)
        motions = [standing.motion(None, 0.0, objects.keys)]
    moved = is_placed(objects, first)
    for number, other in enumerate(objects.others, 1):
        if other.placing is None and moved:
            raise UsageError(f"{other.glb}: give at and size too, as the first object is placed")
        vertices = scene.only(number).pose(0.0).vertices()
        contact = contact_point(vertices, other.ground_y)
        standing = _Standing(other.glb, vertices, contact, ground)
        motions.append(_motion_of(other, standing))
    return Staged(
        objects=replace(objects, ground_y=ground.height),
        scene=scene.with_motions(motions),
        view=view,
        notes=notes,
    )


def _motion_of(other: FurtherObject, standing: _Standing) -> ObjectMotion | None:
    """How an object beside the first one stands; None: as its file has it."""
    if other.placing is None:
        return None
    with _named(other.glb):
        time_s = _time_of_place(other.at_frame, standing.ground.view)
    return standing.motion(other.placing, time_s, other.keys)


def _time_of_key(key: PlaceKey, view: View) -> float:
    """Its moment [s]."""
    return key.time_s if key.time_s is not None else _time_of_frame(key.frame or 0, view)


def _time_of_place(frame: int, view: View) -> float:
    """Time of the frame that a place is of, 0 for the first one whose camera is known [s]."""
    if not frame and view.solved is not None and view.solved.keys:
        return view.solved.keys[0].pts_s
    return _time_of_frame(frame, view)


def _time_of_frame(frame: int, view: View) -> float:
    """Time of a frame of the plate [s].

    Raises:
        UsageError: the plate's camera, or a still, has no such frame.
    """
    keys = () if view.solved is None else view.solved.keys
    known = [key.pts_s for key in keys if key.index == frame]
    if known:
        return known[0]
    if len(keys) > 1:
        raise UsageError(
            f"frame {frame}: the plate's camera has no such frame, only {keys[0].index} to "
            f"{keys[-1].index}; give keys among them, or --camera-from of the whole plate"
        )
    first, start_s = (keys[0].index, keys[0].pts_s) if keys else (0, 0.0)
    if frame != first and not view.frame_s:
        raise UsageError(f"frame {frame}: the plate has no frame rate; give the time in seconds")
    return start_s + (frame - first) * view.frame_s


class _Ground(Struct, frozen=True):
    """The ground, and the camera that sees it."""

    first: Scene
    view: View
    height: float

    def camera(self, time_s: float) -> Camera:
        return self.view.camera_at(self.first, time_s)

    def point(self, at: tuple[float, float], time_s: float) -> Float64:
        """The point (3,) that a place of the frame shows at a time."""
        camera = self.camera(time_s)
        ray, depth = ground_seen_at(at, camera, self.height, self.view.distortion)
        pose = camera.world_from_camera
        return np.asarray(pose[:3, 3] + depth * pose[:3, :3] @ ray)

    def azimuth(self, time_s: float) -> float:
        """Turn about the vertical of what faces the camera [rad]."""
        pose = self.camera(time_s).world_from_camera
        return math.atan2(pose[0, 2], pose[2, 2])


class _Standing(Struct, frozen=True):
    """An object as its file has it at time 0, and the ground that it is put on."""

    glb: Path
    vertices: Float32
    contact: Float64
    ground: _Ground

    def motion(self, wish: GroundPlacing | None, wish_s: float, keys: PlaceKeys) -> ObjectMotion:
        """Where it is over time.

        Args:
            wish: what holds where no key says otherwise; None: as its file has it.
            wish_s: the moment that `wish` is of, unless the place is keyed [s].
            keys: what changes.

        Raises:
            SceneError: there is no ground, or the object would reach behind the camera.
            UsageError: a key's frame, or the plate's scale, is not known.
        """
        smooth, ground = keys.interpolation == "smooth", self.ground
        times = {name: self._times(keys, name) for name in ("at", "size", "yaw")}
        first_s = next(iter(times["at"]), wish_s)
        axes = turn_about_up(ground.azimuth(first_s))  # no number depends on another object's turn
        wishes = [(key.at, s) for key, s in zip(keys.of("at"), times["at"], strict=True)]
        if not wishes and wish is not None:
            wishes = [(wish.at, wish_s)]
        places = [self.contact if at is None else self._point(at, s) for at, s in wishes]
        places = places or [self.contact]
        place = Curve(np.array(times["at"] or [0.0]), np.array(places) @ axes, smooth)
        if keys.of("yaw"):
            facing = np.unwrap([ground.azimuth(s) for s in times["yaw"]])
            turns = facing + np.radians([key.yaw_deg or 0.0 for key in keys.of("yaw")])
        else:
            turns = np.array([0.0])
            if wish is not None:
                turns += math.radians(wish.yaw_deg) + ground.azimuth(first_s)
        turn = Curve(np.array(times["yaw"] or [0.0]), turns[:, None], smooth)
        moving = ObjectMotion(self.contact, axes, place, turn, _UNSCALED)
        sizes = zip(keys.of("size"), times["size"], strict=True)
        scales = [self._scale(moving, s, key.size, key.height_m) for key, s in sizes]
        if not scales and wish is not None:
            scales = [self._scale(moving, first_s, wish.size, wish.height_m)]
        scale = Curve(np.array(times["size"] or [0.0]), np.array(scales or [1.0])[:, None], smooth)
        return replace(moving, scale=scale)

    def _times(self, keys: PlaceKeys, name: str) -> list[float]:
        """Moments of the keys that give a quantity, increasing [s]."""
        with _named(self.glb):
            return [_time_of_key(key, self.ground.view) for key in keys.of(name)]

    def _point(self, at: tuple[float, float], time_s: float) -> Float64:
        with _named(self.glb, time_s):
            return self.ground.point(at, time_s)

    def _scale(
        self, moving: ObjectMotion, time_s: float, size: float | None, height_m: float | None
    ) -> float:
        """Scene units by those of the file, with its size as the frame shows it at a time [1]."""
        if height_m is not None:
            return self._scale_in_metres(height_m)
        if size is None:
            raise UsageError(f"{self.glb}: its size is not given")
        camera = self.ground.camera(time_s)
        pose = camera.world_from_camera
        place = camera.to_camera(moving.place_at(time_s)[None])[0]
        depth = -float(place[2])
        with _named(self.glb, time_s):
            if not depth > 0.0:
                raise SceneError("it lies behind the camera; give its size where it is in view")
            x, y = camera.pixels(place[None])[0]
            placing = Placement(
                at=(x / camera.width, y / camera.height), size=size, horizon=None
            )  # fmt: skip
            axes = moving.turned_at(time_s).T @ pose[:3, :3]
            wanted = contact_depth(
                self.vertices, self.contact, placing, axes, place / depth, camera.fy, camera.height
            )
        return depth / wanted

    def _scale_in_metres(self, height_m: float) -> float:
        unit_m = self.ground.view.unit_m
        if unit_m is None:
            raise UsageError(
                f"{self.glb}: height {height_m:g}m: the plate's scale is not known; give size, or "
                "the camera in metres (nlens-video solve --marker SIDE, --person-height)"
            )
        tall = float(self.vertices[:, 1].max() - self.contact[1])
        if not tall > 0.0:
            raise SceneError(f"{self.glb}: height: the object does not rise above its ground")
        return height_m / unit_m / tall


_UNSCALED = Curve(np.zeros(1), np.ones((1, 1)))


@contextmanager
def _named(glb: Path, time_s: float | None = None) -> Iterator[None]:
    """Say of which object, and which moment of it, an error is."""
    try:
        yield
    except (SceneError, UsageError) as error:
        when = "" if time_s is None else f", at {time_s:g} s"
        raise type(error)(f"{glb}{when}: {error}") from error
