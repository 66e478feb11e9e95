"""Files of cameras: which reader and writer a name asks for."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

from nlens_video.cameras.camera_json import camera_of_json
from nlens_video.cameras.chan import CHAN, from_chan, to_chan
from nlens_video.cameras.colmap import TEXT_FILES, read_colmap
from nlens_video.cameras.fspy import from_fspy, is_fspy
from nlens_video.cameras.glb import from_glb, to_glb
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.cameras.text import broken_json, read_text
from nlens_video.cameras.usd import SUFFIXES, from_usd, layers_beside, require_usd, to_usda
from nlens_video.core.errors import SceneError, UsageError

_RATE = Fraction(24)  # of files that count frames, where the plate's rate is not known
_ROUNDED_S = 2e-3  # times of Matroska are whole milliseconds
_SQUARE = 0.005  # pixels this near to square are taken for square [1]
_WRITERS: dict[str, Callable[[SolvedCamera], bytes]] = {
    ".json": lambda camera: camera.to_json().encode(),
    ".glb": to_glb,
    ".chan": lambda camera: to_chan(camera).encode(),
    ".usda": to_usda,
}
KNOWN = (
    "camera.json, fSpy's .json, Nuke's .chan, a .glb or .gltf, a .usda, .usdc, .usd or .usdz, or "
    "the folder of a COLMAP text model"
)


def read_camera(
    path: Path, size: tuple[int, int], rate: Fraction | None, tick: Fraction | None = None,
    pixel_aspect: float | None = None,
) -> SolvedCamera:  # fmt: skip
    """Read a camera for a plate.

    Args:
        path: `camera.json`, fSpy's `.json`, Nuke's `.chan`, a glTF or USD file, or the folder of a
            COLMAP text model.
        size: columns and rows of the plate [px].
        rate: frames a second of the plate, None where it is not known.
        tick: unit of the plate's times, None where it is not known [s]. Files that count frames get
            the times that frames have in the plate: Matroska's are whole milliseconds.
        pixel_aspect: width of a pixel of the plate by its height, None where it is not known: as
            `camera.json` says, else square [1].

    Raises:
        SceneError: it cannot be read, holds no camera, or that of a frame of another shape.
        UsageError: it is a USD file, and OpenUSD is not installed.
    """
    suffix, across = path.suffix.lower(), pixel_aspect or 1.0
    if suffix in SUFFIXES:
        require_usd(path)
    if not path.exists():
        raise SceneError(f"{path}: there is no such file or folder; expected {KNOWN}")
    if path.is_dir():
        times = _frame_times(rate or _RATE, tick)
        return read_colmap(path, times, size, across).resized(*size, across)
    if suffix in (".glb", ".gltf"):
        return from_glb(path, size, rate or _RATE, across).resized(*size, across)
    if suffix in SUFFIXES:
        return from_usd(path, size, rate or _RATE, across)
    text = read_text(path, CHAN if suffix == ".chan" else KNOWN)
    if suffix == ".chan":
        return from_chan(text, str(path), size, _frame_times(rate or _RATE, tick), across)
    if path.name in TEXT_FILES:
        raise SceneError(
            f"{path}: this is one file of a COLMAP text model; expected its folder; give "
            f"{path.parent}"
        )
    try:
        raw = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path}: no camera ({broken_json(error)}); expected {KNOWN}") from error
    if is_fspy(raw):
        return _displayed(from_fspy(raw, str(path)), path, size, across)
    return camera_of_json(text, str(path)).resized(*size, pixel_aspect)


def beside_camera(path: Path) -> list[Path]:
    """Files that are read with a camera's: those of a folder, the layers of a USD file.

    Raises:
        UsageError: it is a USD file, and OpenUSD is not installed.
    """
    if path.is_dir():
        return [path / name for name in TEXT_FILES]
    return layers_beside(path) if path.suffix.lower() in SUFFIXES else []


def _displayed(
    camera: SolvedCamera, path: Path, size: tuple[int, int], pixel_aspect: float
) -> SolvedCamera:
    """The camera of a picture whose pixels were taken for square, for a plate."""
    if abs(pixel_aspect - 1.0) > _SQUARE and camera.fits(*size):
        raise SceneError(
            f"{path}: fSpy takes pixels for square, the plate's are {pixel_aspect:.4g} times as "
            f"wide as high; open the plate's picture in fSpy as it is displayed, at "
            f"{round(size[0] * pixel_aspect)}x{size[1]}"
        )
    return camera.resized(*size, pixel_aspect)


def _frame_times(rate: Fraction, tick: Fraction | None) -> Callable[[int], float]:
    """Takes the number of a frame to its time [s], a whole number of ticks."""

    def time_s(index: int) -> float:
        exact = index / rate
        return float(exact if not tick else math.floor(exact / tick + Fraction(1, 2)) * tick)

    return time_s


def check_camera_name(path: Path) -> None:
    """Refuse a name that no format has.

    Raises:
        UsageError: the suffix is of no format that can be written, or OpenUSD is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise UsageError(
            f"{path}: no format of cameras; expected a name that ends in {', '.join(_WRITERS)}"
        )
    if suffix in SUFFIXES:
        require_usd(path)


def lost_in(camera: SolvedCamera, path: Path) -> tuple[str, ...]:
    """What a file of that name cannot hold of a camera, in words; errors and method are left out.

    Args:
        camera: to be written.
        path: of the file; its suffix tells the format.
    """
    if path.suffix.lower() != ".chan":
        return ()
    first = camera.keys[0].index
    parts = (
        ("the lens distortion", camera.distortion_k1 != 0.0),
        ("the principal point", camera.principal_px is not None),
        (f"that frames before {first} have no camera", first > 0),
        ("the times of a variable frame rate", not _steady(camera.keys)),
        ("that the field of view is assumed", camera.fov == "assumed"),
        ("that pitch and roll are assumed", camera.horizon == "assumed"),
        ("that its unit is the metre", camera.scale == "metres"),
    )
    return tuple(what for what, there in parts if there)


def _steady(keys: Sequence[CameraKey]) -> bool:
    """Whether the frames come at a constant rate, but for the rounding of their times."""
    first, last = keys[0], keys[-1]
    if first is last:
        return True
    frame_s = (last.pts_s - first.pts_s) / (last.index - first.index)
    return all(
        abs(key.pts_s - first.pts_s - frame_s * (key.index - first.index)) < _ROUNDED_S
        for key in keys
    )


def camera_bytes(camera: SolvedCamera, path: Path) -> bytes:
    """The bytes of a camera in the format that the file's name asks for.

    Raises:
        UsageError: no format has this suffix.
    """
    check_camera_name(path)
    return _WRITERS[path.suffix.lower()](camera)
