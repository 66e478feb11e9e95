"""Camera paths as Nuke's .chan files, which 3DEqualizer, Maya, Houdini and Blender also write.

A line is `frame tx ty tz rx ry rz [vfov]`: position, rotation [deg], vertical field of view [deg].
Axes are glTF's. Nuke's cameras rotate about Z, then X, then Y.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from msgspec.structs import replace

from nlens_video.cameras.ground_grid import on_ground_zero
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64

ORDER: Literal["zxy"] = "zxy"
"""Rotation order of Nuke's cameras, about fixed axes (scipy's lower case)."""
CHAN = (
    "Nuke's .chan: a line for each frame with its number, position, rotation and vertical field "
    "of view in degrees"
)
_STEEP = 1e-9  # cosine of a pitch


def from_chan(
    text: str, source: str, size: tuple[int, int], time_s: Callable[[int], float],
    pixel_aspect: float = 1.0,
) -> SolvedCamera:  # fmt: skip
    """Read the text of a .chan file; its first frame is the plate's first.

    Args:
        text: the file.
        source: what messages call it.
        size: columns and rows of the plate [px].
        time_s: takes a frame of the plate to its time [s].
        pixel_aspect: width of a pixel by its height [1].

    Raises:
        SceneError: a line is wrong, or there is none.
    """
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            values = [float(word) for word in words]
        except ValueError as error:
            raise SceneError(
                f"{source}, line {number}: {line.strip()[:40]!r} is not of numbers; expected {CHAN}"
            ) from error
        if len(values) < 8:
            raise SceneError(
                f"{source}, line {number}: {len(values)} numbers, expected 8 ({CHAN}); export it "
                "again with its field of view"
            )
        if not np.isfinite(values).all() or not 0.0 < values[7] < 180.0:
            raise SceneError(
                f"{source}, line {number}: a field of view of {values[7]:g} degrees, or a number "
                f"that is not finite; expected {CHAN}"
            )
        rows.append(values)
    if not rows:
        raise SceneError(f"{source}: no line but comments; expected {CHAN}")
    rows.sort()
    aspect = size[0] * pixel_aspect / size[1]
    keys = tuple(_key(row, round(row[0] - rows[0][0]), aspect, time_s) for row in rows)
    if any(b.index <= a.index for a, b in zip(keys, keys[1:], strict=False)):
        raise SceneError(f"{source}: a frame is given twice")
    return SolvedCamera(
        width=size[0], height=size[1], keys=keys, fov="measured", horizon="measured",
        path="still" if len(keys) == 1 else "moving", method="Nuke .chan",
        pixel_aspect=pixel_aspect,
    )  # fmt: skip


def to_chan(camera: SolvedCamera) -> str:
    """The text of a .chan file, frames counted from 0; `files.lost_in` tells what is lost."""
    camera = on_ground_zero(camera)
    keys = camera.keys
    if keys[0].index > 0:  # the first line is the plate's first frame
        keys = (replace(keys[0], index=0), *keys)
    lines = []
    for key in keys:
        pose = key.world_from_camera
        tan = math.tan(0.5 * math.radians(key.fov_x_deg)) / camera.aspect
        fov_y = 2.0 * math.degrees(math.atan(tan))
        values = (*pose[:3, 3], *_turns_deg(pose[:3, :3]), fov_y)
        lines.append(f"{key.index}\t" + "\t".join(f"{value:.9g}" for value in values))
    return "\n".join(lines) + "\n"


def _turns_deg(rotation: Float64) -> tuple[float, float, float]:
    """Turns about X, Y and Z of a rotation (3, 3) in the order of `ORDER` [deg]."""
    level = math.hypot(rotation[0, 2], rotation[2, 2])
    x = math.atan2(-rotation[1, 2], level)
    if level < _STEEP:  # straight up or down, a turn about Z is one about Y
        y, z = math.atan2(-rotation[2, 0], rotation[0, 0]), 0.0
    else:
        y = math.atan2(rotation[0, 2], rotation[2, 2])
        z = math.atan2(rotation[1, 0], rotation[1, 1])
    return math.degrees(x), math.degrees(y), math.degrees(z)


def _key(row: list[float], index: int, aspect: float, time_s: Callable[[int], float]) -> CameraKey:
    from scipy.spatial.transform import Rotation  # here: scipy takes long to load

    turns = dict(zip("xyz", row[4:7], strict=True))
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler(
        ORDER, [turns[axis] for axis in ORDER], degrees=True
    ).as_matrix()
    pose[:3, 3] = row[1:4]
    tan = math.tan(0.5 * math.radians(row[7])) * aspect
    return CameraKey(
        index=index,
        pts_s=time_s(index),
        world_to_camera=np.asarray(np.linalg.inv(pose)),
        fov_x_deg=2.0 * math.degrees(math.atan(tan)),
    )
