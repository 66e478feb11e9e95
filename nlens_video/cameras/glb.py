"""Camera paths as GLB: an animated camera, a grid on the ground and the points of the solve.

A field of view that changes is animated by KHR_animation_pointer. The principal point is lost to
other programs: glTF's cameras have it in the middle.
"""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import numpy as np

from nlens_video.cameras.camera_json import DESCRIPTION, described_camera, description
from nlens_video.cameras.ground_grid import ground_lines, on_ground_zero, square_size
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.objects import ALL
from nlens_video.core.version import VERSION
from nlens_video.scene.camera import Perspective, read_cameras, rigid
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.animation_reader import read_animations
from nlens_video.scene.gltf.animations import Animation
from nlens_video.scene.gltf.document import read_document
from nlens_video.scene.gltf.nodes import Hierarchy, read_hierarchy
from nlens_video.scene.gltf.writer import Fields, GlbWriter

_POINTS, _LINES = 0, 1  # modes of primitives
_NEAR, _FAR = 0.05, 1000.0  # what is drawn [squares of the grid]
_SAME_ASPECT = 0.01
_APART = 0.01  # key times this close to a frame's are that frame's [frame]
_MOST_FRAMES = 50_000


def to_glb(camera: SolvedCamera) -> bytes:
    """The bytes of a GLB file; times count from the plate's first frame."""
    from scipy.spatial.transform import Rotation  # here: scipy takes long to load

    camera = on_ground_zero(camera)
    angles = np.array([_fov(key.fov_x_deg, 1.0 / camera.aspect) for key in camera.keys])
    poses = np.array([key.world_from_camera for key in camera.keys])
    turns = _continuous(Rotation.from_matrix(poses[:, :3, :3]).as_quat())
    places = poses[:, :3, 3]
    side = square_size(camera)
    glb = GlbWriter()
    glb.document["asset"]["generator"] = f"nlens-video {VERSION}"
    glb.document["asset"]["extras"] = {DESCRIPTION: description(camera)}
    lens = {
        "yfov": float(angles[0]), "aspectRatio": camera.aspect,
        "znear": _NEAR * side, "zfar": _FAR * side,
    }  # fmt: skip
    number = glb.add("cameras", {"name": "plate", "type": "perspective", "perspective": lens})
    node = glb.node(
        name="camera", camera=number, translation=places[0].tolist(), rotation=turns[0].tolist()
    )
    if len(camera.keys) > 1:
        times = np.array([key.pts_s for key in camera.keys])
        zoom = (f"/cameras/{number}/perspective/yfov", "pointer", times, angles, "LINEAR")
        glb.animation(
            (node, "translation", times, places, "LINEAR"),
            (node, "rotation", times, turns, "LINEAR"),
            *([zoom] if np.ptp(angles) > 0.0 else []),
            name="camera",
        )
    _add_mesh(glb, "ground", ground_lines(camera).reshape(-1, 3), _LINES)
    if camera.points is not None and len(camera.points):
        _add_mesh(glb, "points", camera.points, _POINTS)
    return glb.bytes()


def from_glb(
    path: Path, size: tuple[int, int], rate: Fraction, pixel_aspect: float = 1.0
) -> SolvedCamera:
    """Read a file's first perspective camera, at all frames and at all its keys.

    Time 0 is the plate's first frame, the unit the metre, and the ground y = 0.

    Args:
        path: a `.glb` or `.gltf` file.
        size: columns and rows of the plate [px].
        rate: frames a second of the plate.
        pixel_aspect: width of a pixel of the plate by its height [1].

    Raises:
        SceneError: it cannot be read, has no camera, or one of another aspect ratio.
    """
    try:
        return _read(path, size, rate, pixel_aspect)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error


def _read(path: Path, size: tuple[int, int], rate: Fraction, pixel_aspect: float) -> SolvedCamera:
    document = read_document(path)
    accessors, hierarchy = AccessorReader(document), read_hierarchy(document)
    cameras = read_cameras(document, hierarchy.visible)
    if not cameras:
        raise SceneError("no perspective camera; export the scene with its camera")
    camera, aspect = cameras[0], size[0] * pixel_aspect / size[1]
    if camera.aspect_ratio is not None and abs(camera.aspect_ratio / aspect - 1) > _SAME_ASPECT:
        squares = pixel_aspect == 1.0
        shape = f"has {size[0]}x{size[1]}" if squares else f"is displayed as {aspect:.4g}:1"
        raise SceneError(
            f"camera '{camera.name}' is for pictures of {camera.aspect_ratio:.4g}:1, the plate "
            f"{shape}; set that {'size' if squares else 'shape'} in the scene and export it again"
        )
    chosen = hierarchy.with_ancestors([camera.node])
    tracks = read_animations(document, accessors, hierarchy, {}).of_cameras(chosen, ALL).tracks
    motion = Animation(tuple(t for t in tracks if t.path != "yfov" or t.node == camera.number))
    keys = [
        _key(camera, hierarchy, motion, time_s, aspect, rate) for time_s in _times(motion, rate)
    ]
    extras = document.root.child("asset").data.get("extras")
    found = extras.get(DESCRIPTION) if isinstance(extras, dict) else None
    return described_camera(
        keys, size, found, "camera", pixel_aspect, scale="metres", method="glTF"
    )


def _times(motion: Animation, rate: Fraction) -> list[float]:
    """Times of the frames up to the last key, and of keys between them [s]."""
    if not motion.tracks:
        return [0.0]
    keys = {time_s for track in motion.tracks for time_s in track.times}
    count = math.ceil(motion.duration_s * rate - _APART) + 1
    frames = {index: float(index / rate) for index in range(count if count <= _MOST_FRAMES else 1)}
    between = []
    for time_s in keys:
        index = round(time_s * rate)
        if index in frames and abs(time_s * rate - index) <= _APART:
            frames[index] = time_s  # the clip's own time, which its container rounds
        else:
            between.append(time_s)
    return sorted([*frames.values(), *between])


def _key(
    camera: Perspective,
    hierarchy: Hierarchy,
    motion: Animation,
    time_s: float,
    aspect: float,
    rate: Fraction,
) -> CameraKey:
    pose = rigid(hierarchy.oriented(motion.apply(hierarchy.rest, time_s))[camera.node])
    yfov = camera.yfov_at(motion, time_s)
    return CameraKey(
        index=round(time_s * rate),
        pts_s=time_s,
        world_to_camera=np.asarray(np.linalg.inv(pose)),
        fov_x_deg=2.0 * math.degrees(math.atan(math.tan(0.5 * yfov) * aspect)),
    )


def _fov(degrees: float, ratio: float) -> float:
    """Field of view of a side that is `ratio` times as long as that of `degrees` [rad]."""
    return 2.0 * math.atan(math.tan(0.5 * math.radians(degrees)) * ratio)


def _continuous(turns: Float64) -> Float64:
    """Quaternions (K, 4) of which each lies on the same side as the one before."""
    flips = np.sign(np.einsum("kc,kc->k", turns[1:], turns[:-1]))
    turns[1:] *= np.cumprod(np.where(flips < 0.0, -1.0, 1.0))[:, None]
    return turns


def _add_mesh(glb: GlbWriter, name: str, positions: Float64, mode: int) -> None:
    """A mesh of lines or points, which programs show and renderers leave out."""
    values = positions.astype(np.float32)
    bounds: Fields = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
    primitive = {"attributes": {"POSITION": glb.accessor(values, **bounds)}, "mode": mode}
    glb.node(name=name, mesh=glb.add("meshes", {"name": name, "primitives": [primitive]}))
