"""Camera paths from COLMAP's text models: cameras.txt, images.txt, points3D.txt.

COLMAP's camera looks along +Z with Y down, and its world has no up: the ground is found among its
points. Pictures are named after frames; the last number of a name before its suffix counts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.cameras.ground import fit_ground, ground_frame
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.cameras.text import read_text
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between COLMAP's camera axes and glTF's (4, 4)."""
EYE_HEIGHT = 1.6
"""Height that the first camera gets above the ground, where no scale is known [scene unit]."""
TEXT_FILES = "cameras.txt", "images.txt", "points3D.txt"
_MODEL = f"a COLMAP text model ({', '.join(TEXT_FILES)})"
_PARAMETERS = {
    "SIMPLE_PINHOLE": (1, 3), "PINHOLE": (2, 4), "SIMPLE_RADIAL": (1, 4), "RADIAL": (1, 5),
    "OPENCV": (2, 8), "FULL_OPENCV": (2, 12),
}  # fmt: skip
"""Camera models: how many of their parameters are focal lengths [px], and how many there are."""
_COEFFICIENTS = 8  # of distortion, in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6
_LEFT_OUT = 0.005  # distortion at the frame's edge that one k1 for all may miss, by its width
_EDGE_POINTS = 33  # at which that is looked at, along each side
_SAME_PIXELS = 0.005  # by which the ratio of two focal lengths may miss the pixels' shape [1]
_ZERO = np.zeros(3)  # neither turn nor shift
_SUFFIX = re.compile(r"\.\d*[A-Za-z]\w*$")  # of a name: `.jp2`, not the `.0001` of a frame
_COUNTED = re.compile(r"# *Number of \w+: (\d+)")


class _Lens(Struct, frozen=True):
    """A camera of a model.

    Attributes:
        size: columns and rows [px].
        focal: focal length along columns [px].
        pixel_aspect: of that along rows to it: width of a pixel by its height [1].
        principal: principal point [px].
        distortion: coefficients in OpenCV's order, 0 where the model has none (8,) [1].
    """

    size: tuple[int, int]
    focal: float
    pixel_aspect: float
    principal: tuple[float, float]
    distortion: Float64

    @property
    def edge(self) -> Float64:
        """Points along the frame's edge as a pinhole sees them, at depth 1 (N, 3)."""
        along = np.linspace(0.0, 1.0, _EDGE_POINTS)
        across, ends = np.meshgrid(along, [0.0, 1.0])
        shares = np.stack([np.append(across, ends), np.append(ends, across)], axis=1)
        focals = self.focal, self.focal * self.pixel_aspect
        return np.insert((shares * self.size - self.principal) / focals, 2, 1.0, axis=1)

    def missed(self, k1: float) -> float:
        """How far k1 alone is off at the frame's edge, by its width; infinite beyond numbers."""
        with np.errstate(all="ignore"):
            whole, alone = (
                cv2.projectPoints(self.edge, _ZERO, _ZERO, np.eye(3), coefficients)[0]
                for coefficients in (self.distortion, _padded([k1]))
            )
            off = float(np.linalg.norm(whole - alone, axis=2).max()) * self.focal / self.size[0]
        return off if math.isfinite(off) else math.inf


def read_colmap(
    folder: Path, time_s: Callable[[int], float], size: tuple[int, int], pixel_aspect: float
) -> SolvedCamera:
    """The camera path of a text model, on the ground that its points show.

    Args:
        folder: of the three files.
        time_s: takes a frame of the plate to its time [s].
        size: columns and rows of the plate [px].
        pixel_aspect: width of a pixel of the plate by its height [1].

    Raises:
        SceneError: a file is missing or wrong, cameras of several sizes or with other pixels than
            the plate's, or no ground is found.
    """
    _check_folder(folder)
    cameras = _cameras(folder / "cameras.txt")
    shots = _images(folder / "images.txt")
    points = _points(folder / "points3D.txt")
    if {shot[1] for shot in shots} - set(cameras):
        raise SceneError(
            f"{folder}: images.txt names a camera that cameras.txt does not hold; export both again"
        )
    lenses = [cameras[shot[1]] for shot in shots]
    width, height = lenses[0].size
    if any(lens.size != (width, height) for lens in lenses):
        raise SceneError(f"{folder}: pictures of several sizes; expected those of one plate")
    squares = SolvedCamera(width=width, height=height, keys=())
    own = pixel_aspect if squares.fits(*size) else 1.0  # else of pictures as they are displayed
    _check_pixels(lenses, own, folder)
    bend = _bend(lenses, folder)
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
    for (index, _, _), lens, pose in zip(shots, lenses, poses, strict=True):
        level = similarity @ pose
        level[:3, :3] /= scale
        keys.append(
            CameraKey(
                index=index - shots[0][0],
                pts_s=time_s(index - shots[0][0]),
                world_to_camera=np.asarray(np.linalg.inv(level)),
                fov_x_deg=2.0 * math.degrees(math.atan(0.5 * width / lens.focal)),
            )
        )
    return SolvedCamera(
        width=width, height=height, keys=tuple(keys), fov="measured", horizon="measured",
        path="moving" if len(keys) > 1 else "still", method="COLMAP",
        principal_px=lenses[0].principal, distortion_k1=bend, pixel_aspect=own,
    )  # fmt: skip


def _check_folder(folder: Path) -> None:
    missing = [name for name in TEXT_FILES if not (folder / name).exists()]
    if not missing:
        return
    if (folder / "cameras.bin").exists():
        raise SceneError(
            f"{folder}: a binary model of COLMAP; expected {_MODEL}; write it by colmap "
            f"model_converter --input_path {folder} --output_path {folder} --output_type TXT"
        )
    raise SceneError(
        f"{folder}: a folder without {', '.join(missing)}; expected {_MODEL}; give the folder that "
        "holds these files"
    )


def _lines(path: Path) -> list[str]:
    """The lines that are no comments; empty ones stay."""
    lines = read_text(path, f"a file of {_MODEL}").splitlines()
    return [line for line in lines if not line.startswith("#")]


def _check_count(path: Path, found: int) -> None:
    """Refuse a file that holds less than its head says."""
    for line in read_text(path, _MODEL).splitlines():
        counted = _COUNTED.match(line)
        if counted and int(counted[1]) != found:
            raise SceneError(
                f"{path}: {found} entries where its head says {counted[1]}; it is cut off: export "
                "it again"
            )


def _wrong(path: Path, line: str, expected: str) -> SceneError:
    return SceneError(f"{path}: {line[:60]!r} is no {expected}; export the model again")


def _cameras(path: Path) -> dict[str, _Lens]:
    found = {}
    for line in filter(str.strip, _lines(path)):
        name, model, *numbers = [*line.split(), ""][:2] + line.split()[2:]
        if model and model not in _PARAMETERS:
            raise SceneError(
                f"{path}: camera model {model}; expected one of {', '.join(_PARAMETERS)}; "
                "undistort the pictures (colmap image_undistorter) or solve with another model"
            )
        try:
            size = int(numbers[0]), int(numbers[1])
            values = [float(number) for number in numbers[2:]]
            focals, count = _PARAMETERS[model]
        except (IndexError, KeyError, ValueError) as error:
            raise _wrong(path, line, "camera") from error
        if len(values) != count:
            raise _wrong(path, line, f"camera of {count} parameters")
        if not np.isfinite(values).all() or min(values[:focals]) <= 0.0 or min(size) < 1:
            raise SceneError(f"{path}: camera {name} has no focal length or no size")
        after = focals + 2
        found[name] = _Lens(
            size,
            values[0],
            values[focals - 1] / values[0],
            (values[focals], values[focals + 1]),
            _padded(values[after:]),
        )
    _check_count(path, len(found))
    return found


def _padded(coefficients: list[float]) -> Float64:
    """Leading coefficients of distortion with zeros for the others (8,)."""
    return np.pad(np.array(coefficients), (0, _COEFFICIENTS - len(coefficients)))


def _check_pixels(lenses: list[_Lens], pixel_aspect: float, folder: Path) -> None:
    """Refuse pictures with pixels of another shape than theirs [1]."""
    worst = max(lenses, key=lambda lens: abs(lens.pixel_aspect / pixel_aspect - 1.0))
    if abs(worst.pixel_aspect / pixel_aspect - 1.0) > _SAME_PIXELS:
        raise SceneError(
            f"{folder}: focal lengths of {worst.focal:.6g} and "
            f"{worst.focal * worst.pixel_aspect:.6g} px, so of pixels that are "
            f"{worst.pixel_aspect:.4g} times as wide as high, the plate's are {pixel_aspect:.4g} "
            "times; solve again from the pictures as they are displayed, with one focal length "
            "(--ImageReader.camera_model SIMPLE_RADIAL)"
        )


def _bend(lenses: list[_Lens], folder: Path) -> float:
    """One radial coefficient for all pictures [1]."""
    bend = float(np.median([lens.distortion[0] for lens in lenses]))
    missed = max(lens.missed(bend) for lens in lenses)
    if missed > _LEFT_OUT:
        raise SceneError(
            f"{folder}: a lens whose distortion one k1 for all pictures misses by "
            f"{100.0 * missed:.1f} % of the width at the frame's edge; expected one lens; "
            "undistort the pictures (colmap image_undistorter) and take them as the plate"
        )
    return bend


def _points(path: Path) -> Float64:
    """Positions of the points (N, 3)."""
    found = []
    for line in filter(str.strip, _lines(path)):
        words = line.split()
        try:
            x, y, z = (float(word) for word in words[1:4])
        except ValueError as error:
            raise _wrong(path, line, "point") from error
        if not math.isfinite(x + y + z):
            raise _wrong(path, line, "point")
        found.append((x, y, z))
    _check_count(path, len(found))
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def _images(path: Path) -> list[tuple[int, str, Float64]]:
    """Frame, camera and camera-from-world matrix of each picture, by frame."""
    from scipy.spatial.transform import Rotation  # here: scipy takes long to load

    found = []
    lines = iter(_lines(path))
    for line in lines:
        words = line.split()
        if not words:
            continue
        next(lines, None)  # the picture's points; the line is empty where it has none
        number = re.findall(r"\d+", _SUFFIX.sub("", " ".join(words[9:])))
        if words[9:] and not number:
            raise SceneError(
                f"{path}: picture {' '.join(words[9:])[:60]!r} has no number; expected pictures "
                "named after frames, as frame_0001.png"
            )
        try:
            w, x, y, z = (float(word) for word in words[1:5])
            matrix = np.eye(4)
            matrix[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
            matrix[:3, 3] = [float(word) for word in words[5:8]]
            found.append((int(number[-1]), words[8], matrix))
        except (IndexError, ValueError) as error:
            raise _wrong(path, line, "picture of a frame") from error
    _check_count(path, len(found))
    found.sort(key=lambda shot: shot[0])
    if not found:
        raise SceneError(
            f"{path}: no picture; expected the pictures that the model was solved from"
        )
    if len({shot[0] for shot in found}) < len(found):
        raise SceneError(
            f"{path}: two pictures are named after one frame; expected one camera's pictures, "
            "whose last number is the frame's"
        )
    return found
