"""Scale of a solved camera by the height of a person who stands on its ground."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from nlens_video.cameras.ground import moved
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import InputError


def scaled_by_person(
    camera: SolvedCamera, box: tuple[float, float, float, float], height_m: float
) -> SolvedCamera:
    """The camera in metres.

    Args:
        camera: the plate's; its first frame shows the person.
        box: left, upper, right, lower border of the person there, from head to feet [frame].
        height_m: of the person, upright [m].

    Raises:
        InputError: the feet do not stand on ground that the camera sees, or the head is not above
            them.
    """
    view = camera.at(camera.keys[0].pts_s)
    column = 0.5 * (box[0] + box[2]) * view.width
    head_row, foot_row = box[1] * view.height, box[3] * view.height
    pose = view.world_from_camera
    across, down = (column - view.cx) / view.fx, -(foot_row - view.cy) / view.fy
    ray, eye = pose[:3, :3] @ np.array([across, down, -1.0]), pose[:3, 3]
    if not ray[1] < 0.0:
        raise InputError(
            f"--person: the lower border {box[3]:g} lies above the solved camera's horizon; "
            "expected the feet, on the ground"
        )
    foot = view.camera_from_world @ np.append(eye + (camera.ground_y - eye[1]) / ray[1] * ray, 1.0)
    up = view.camera_from_world[:3, 1]
    # The height t at which foot + t up is seen in the head's row: y fy = (cy - row) (-z).
    rise = (view.cy - head_row) / view.fy
    tall = -(foot[1] + rise * foot[2]) / (up[1] + rise * up[2])
    if not tall > 0.0:
        raise InputError(
            f"--person: no upright person stands between the rows {box[1]:g} and {box[3]:g}; "
            "expected X0,Y0,X1,Y1 from head to feet, as 0.4,0.2,0.5,0.9"
        )
    similarity = np.eye(4) * (height_m / float(tall))
    similarity[3, 3] = 1.0
    scaled = moved(camera, similarity)
    return replace(
        scaled,
        ground_y=camera.ground_y * height_m / float(tall),
        scale="metres",
        method=f"{camera.method}; scale by a person of {height_m:g} m",
    )
