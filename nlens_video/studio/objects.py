"""The objects of a shot as the page shows them: where each is on a frame, and its way there."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.placement import contact_point
from nlens_video.core.layers import Float64
from nlens_video.core.objects import NO_KEYS, PlaceKey, PlaceKeys
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.view import View
from nlens_video.scene.camera import Camera
from nlens_video.scene.object_motion import ObjectMotion
from nlens_video.scene.scene import Scene
from nlens_video.studio.shadow_guides import ShadowGuides, shadow_guides

FAR = 20.0
"""Farther out nothing is drawn [frame width or height]."""
_STEPS = 120  # of a path
_MOST_FILES = 100
_SUFFIXES = (".glb", ".gltf")
_MOVING = PlaceKeys(
    keys=tuple(PlaceKey(time_s=t, at=(0.5, 0.8), size=0.2, yaw_deg=t) for t in (0.0, 1.0))
)


class ObjectGuides(Struct, frozen=True, kw_only=True):
    """An object on a frame, in fractions of its width and height from its upper left corner.

    Attributes:
        at: where it touches the ground, None where that is behind the camera.
        size: rows from there up to its highest point [frame height].
        yaw: its turn towards the camera of this moment, None where the shot does not place it
            [deg].
        outline: its left, upper, right and lower border.
        placed: whether the shot places it; else it stands where its file has it.
        path: points of its way on the ground, as this frame's camera sees them.
        stops: those of its keys.
        sizes: as `size`, at the first two keys of its place, by the cameras of their moments.
        shadow: what its shadow is drawn by, None where it has no height.
    """

    at: tuple[float, float] | None
    size: float
    yaw: float | None
    outline: tuple[float, float, float, float] | None
    placed: bool
    path: tuple[tuple[float, float], ...] = ()
    stops: tuple[tuple[float, float], ...] = ()
    sizes: tuple[float, ...] = ()
    shadow: ShadowGuides | None = None


def object_guides(
    objects: ObjectSettings, scene: Scene, view: View, time_s: float
) -> tuple[ObjectGuides, ...]:
    """Each object on a frame.

    Args:
        objects: the objects and their places.
        scene: their files, staged.
        view: with the camera that sees them.
        time_s: of the frame [s].
    """
    camera, before = (view.camera_at(scene, moment) for moment in (time_s, 0.0))
    first = not scene.camera_names or bool(objects.placing or objects.on_ground)
    grounds = [objects.ground_y, *(other.ground_y for other in objects.others)]
    keyed = [objects.keys, *(other.keys for other in objects.others)]
    found = []
    for number, (part, ground_y, keys) in enumerate(zip(scene.parts, grounds, keyed, strict=True)):
        own = scene.only(number).pose(0.0).vertices().astype(np.float64)
        contact = contact_point(own.astype(np.float32), ground_y)
        motion, sizes = part.motion, []
        placed = motion is not None if number else first
        turn = 0.0
        if motion is not None:
            for moment in motion.place.times_s[:2] if keys.of("at") else ():
                seeing = view.camera_at(scene, float(moment))
                sizes.append(stand(seeing, *_moved(motion, float(moment), contact, own))[1])
            contact, own = _moved(motion, time_s, contact, own)
            turn = float(motion.turn.at(time_s)[0])
        meshes = part.meshes(part.moved(part.moment(time_s)))
        drawn = [mesh for mesh in meshes if mesh.drawn] or meshes
        moved = np.concatenate([mesh.positions for mesh in drawn])
        at, size = stand(camera, contact, own)
        path, stops = ((), ()) if motion is None else _way(motion, camera)
        found.append(
            ObjectGuides(
                at=at,
                size=size,
                yaw=_yaw_deg(turn, camera) if placed else None,
                outline=_outline(camera, moved.astype(np.float64)),
                placed=placed,
                path=path,
                stops=stops,
                sizes=tuple(sizes),
                shadow=shadow_guides(camera, before, contact, moved.astype(np.float64)),
            )
        )
    return tuple(found)


def without_places(objects: ObjectSettings) -> ObjectSettings:
    """The same objects wherever they stand: what a session keeps when they are moved."""
    others = tuple(
        replace(other, placing=None, at_frame=0, keys=_any(other.keys)) for other in objects.others
    )
    return replace(
        objects, placing=None, on_ground=None, at_frame=0, keys=_any(objects.keys), others=others
    )


def _any(keys: PlaceKeys) -> PlaceKeys:
    """The same for all keys between which something can move."""
    return _MOVING if len(keys.keys) > 1 else NO_KEYS


def object_files(folder: Path) -> list[str]:
    """Names of the objects in a shot's folder, a hundred at most."""
    files = (one for one in folder.iterdir() if one.suffix.lower() in _SUFFIXES)
    return sorted(one.name for one in files if one.is_file())[:_MOST_FILES]


def stand(
    camera: Camera, contact: Float64, vertices: Float64
) -> tuple[tuple[float, float] | None, float]:
    """Where a body touches the ground, and its size; None and 0 where that is out of sight.

    Args:
        camera: sees it.
        contact: where it touches the ground (3,) [scene unit].
        vertices: its own (V, 3) [scene unit].
    """
    spots = _spots(camera, np.vstack([contact[None], vertices]))
    if spots is None or not (np.abs(spots[0]) < FAR).all():
        return None, 0.0
    return (float(spots[0, 0]), float(spots[0, 1])), float(spots[0, 1] - spots[:, 1].min())


def _outline(camera: Camera, vertices: Float64) -> tuple[float, float, float, float] | None:
    """Left, upper, right and lower border; None where a part is behind the camera."""
    spots = _spots(camera, vertices)
    if spots is None:
        return None
    low, high = spots.min(axis=0), spots.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _spots(camera: Camera, points: Float64) -> Float64 | None:
    """Points (N, 3) in fractions of the frame (N, 2); None where one is behind the camera."""
    seen = camera.to_camera(points)
    if not (seen[:, 2] < 0.0).all():
        return None
    return camera.pixels(seen) / (camera.width, camera.height)


def _moved(
    motion: ObjectMotion, time_s: float, contact: Float64, vertices: Float64
) -> tuple[Float64, Float64]:
    """A point (3,) and vertices (V, 3) of a file where they are in the shared world at a time."""
    matrix = motion.at(time_s)
    turned, offset = matrix[:3, :3].T, matrix[:3, 3]
    return contact @ turned + offset, vertices @ turned + offset


def _yaw_deg(turn: float, camera: Camera) -> float:
    """The turn of an object [rad] towards a camera [deg]."""
    pose = camera.world_from_camera
    facing = math.atan2(pose[0, 2], pose[2, 2])
    return math.degrees(turn - facing)


def _way(
    motion: ObjectMotion, camera: Camera
) -> tuple[tuple[tuple[float, float], ...], tuple[tuple[float, float], ...]]:
    """The path, and the places of its keys; nothing where the object does not move."""
    times = motion.place.times_s
    if len(times) < 2:
        return (), ()
    along = np.linspace(times[0], times[-1], _STEPS + 1)
    return _seen(motion, camera, along), _seen(motion, camera, times)


def _seen(
    motion: ObjectMotion, camera: Camera, times_s: Float64
) -> tuple[tuple[float, float], ...]:
    """Places at some moments on the frame, without those that are out of sight."""
    points = camera.to_camera(np.array([motion.place_at(float(time_s)) for time_s in times_s]))
    spots = camera.pixels(points[points[:, 2] < 0.0]) / (camera.width, camera.height)
    return tuple((float(x), float(y)) for x, y in spots if max(abs(x), abs(y)) < FAR)
