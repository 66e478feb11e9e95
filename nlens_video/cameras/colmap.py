"""Camera paths from COLMAP's text models: cameras.txt, images.txt, points3D.txt.

COLMAP's camera looks along +Z with Y down, and its world has no up: the ground is found among its
points. Pictures are named after frames; the last number of a name counts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nlens_video.cameras.ground import fit_ground, ground_frame
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between COLMAP's camera axes and glTF's (4, 4)."""
EYE_HEIGHT = 1.6
"""Height that the first camera gets above the ground, where no scale is known [scene unit]."""
_FOCALS = {
    "SIMPLE_PINHOLE": 1, "PINHOLE": 2, "SIMPLE_RADIAL": 1, "RADIAL": 1, "OPENCV": 2,
    "FULL_OPENCV": 2,
}  # fmt: skip
"""Camera models and how many of their parameters are focal lengths [px]."""


def read_colmap(folder: Path, time_s: Callable[[int], float]) -> SolvedCamera:
    """The camera path of a text model, on the ground that its points show.

    Args:
        folder: of the three files.
        time_s: takes a frame of the plate to its time [s].

    Raises:
        SceneError: a file is missing or wrong, cameras of several sizes, or no ground is found.
    """
    cameras = _cameras(folder / "cameras.txt")
    shots = _images(folder / "images.txt")
    points = np.array(
        [row[1:4] for row in _rows(folder / "points3D.txt")], dtype=np.float64
    ).reshape(-1, 3)
    if {shot[1] for shot in shots} - set(cameras):
        raise SceneError(f"{folder}: images.txt names a camera that cameras.txt does not hold")
    width, height, _, principal = cameras[shots[0][1]]
    poses = np.array([np.linalg.inv(FLIP @ shot[2]) for shot in shots])
    ground = fit_ground(points, poses)
    if ground is None:
        raise SceneError(
            f"{folder}: no ground among {len(points)} points; expected a plane below the cameras "
            "that holds a tenth of them"
        )
    similarity = ground_frame(*ground, poses[0], EYE_HEIGHT)
    scale = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
    keys = []
    for (index, name, _), pose in zip(shots, poses, strict=True):
        focal = cameras[name][2]
        level = similarity @ pose
        level[:3, :3] /= scale
        keys.append(
            CameraKey(
                index=index - shots[0][0],
                pts_s=time_s(index - shots[0][0]),
                world_to_camera=np.asarray(np.linalg.inv(level)),
                fov_x_deg=2.0 * math.degrees(math.atan(0.5 * width / focal)),
            )
        )
    if any(cameras[shot[1]][:2] != (width, height) for shot in shots):
        raise SceneError(f"{folder}: pictures of several sizes; expected those of one plate")
    return SolvedCamera(
        width=width, height=height, keys=tuple(keys), fov="measured", horizon="measured",
        path="moving" if len(keys) > 1 else "still", method="COLMAP", principal_px=principal,
    )  # fmt: skip


def _rows(path: Path) -> list[list[str]]:
    """Words of the lines that are no comments."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(
            f"{path}: cannot be read ({error}); expected COLMAP's text model"
        ) from error
    return [line.split() for line in lines if line.strip() and not line.startswith("#")]


def _cameras(path: Path) -> dict[str, tuple[int, int, float, tuple[float, float]]]:
    """Columns, rows, focal length and principal point of each camera [px]."""
    found = {}
    for words in _rows(path):
        try:
            name, model, width, height = words[0], words[1], int(words[2]), int(words[3])
            values = [float(word) for word in words[4:]]
            focals = _FOCALS[model]
            point = values[focals], values[focals + 1]
        except KeyError as error:
            raise SceneError(
                f"{path}: camera model {error.args[0]}; expected one of {', '.join(_FOCALS)}"
            ) from error
        except (IndexError, ValueError) as error:
            raise SceneError(f"{path}: {' '.join(words)[:60]!r} is no camera") from error
        if not min(values[:focals]) > 0.0 or min(width, height) < 1:
            raise SceneError(f"{path}: camera {name} has no focal length or no size")
        found[name] = width, height, values[0], point
    return found


def _images(path: Path) -> list[tuple[int, str, Float64]]:
    """Frame, camera and camera-from-world matrix of each picture, by frame."""
    from scipy.spatial.transform import Rotation  # here: scipy takes long to load

    found = []
    for words in _rows(path)[::2]:  # every second line holds the picture's points
        number = re.findall(r"\d+", " ".join(words[9:]))
        try:
            w, x, y, z = (float(word) for word in words[1:5])
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
            matrix[:3, 3] = [float(word) for word in words[5:8]]
            found.append((int(number[-1]), words[8], matrix))
        except (IndexError, ValueError) as error:
            raise SceneError(
                f"{path}: {' '.join(words)[:60]!r} is no picture of a frame"
            ) from error
    found.sort(key=lambda shot: shot[0])
    if not found:
        raise SceneError(f"{path}: no picture")
    if len({shot[0] for shot in found}) < len(found):
        raise SceneError(f"{path}: two pictures are named after one frame")
    return found
