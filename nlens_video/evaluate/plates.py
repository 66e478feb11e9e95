"""Plates with known lens: a folder each, rendered with true depth of field.

A plate is a folder that holds `object_coc.npy`, and beside it `bg.png`, `bg_coc.npy`, `object.glb`,
`object_depth.npz`, `object_rgba.png` and `params.json`; `bg_sharp.png` where it is at hand.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, Float32, Float64, UInt8
from nlens_video.scene import Camera, Scene

MARK = "object_coc.npy"
_PARTS = (
    "bg.png", "bg_coc.npy", "object.glb", "object_depth.npz", "object_rgba.png", "params.json",
)  # fmt: skip
_FARTHEST = 1e4  # object depths beyond this mean "nothing there" [scene unit]
_SOLID = 250  # alpha codes above this belong to the object alone


class Plate(Struct, frozen=True, kw_only=True):
    """A plate, its true CoC, and the object that is to be put into it.

    Attributes:
        folder: of its files.
        rgb: the plate, display-coded sRGB in [0, 1] (H, W, 3).
        coc_px: true signed CoC diameter (H, W), nan where it is not known [px].
        sharp: the same view through a pinhole (H, W, 3), None where it was not rendered.
        camera: the virtual camera, which is the true one.
        scene: the object.
        triangles: the object's triangles in the world (T, 3, 3) [scene unit].
        ground_y: height of the plane on which it stands [scene unit].
        alpha: coverage of the sharp object (H, W) [code value].
        object_depth: camera-space depth of the sharp object (H, W) [scene unit].
        object_coc_px: true signed CoC diameter of it (H, W), 0 where it is not known [px].
        there: pixels at which its depth and CoC are known (H, W).
    """

    folder: Path
    rgb: Float32
    coc_px: Float32
    sharp: Float32 | None
    camera: Camera
    scene: Scene
    triangles: Float64
    ground_y: float
    alpha: UInt8
    object_depth: Float32
    object_coc_px: Float32
    there: Bool

    @property
    def name(self) -> str:
        """Name of its folder."""
        return self.folder.name

    @property
    def solid(self) -> Bool:
        """Pixels that the sharp object covers wholly and whose depth and CoC are known (H, W)."""
        return self.there & (self.alpha > _SOLID)

    @property
    def true_coc_px(self) -> Float32:
        """True CoC diameter without its sign (H, W), nan where it is not known [px]."""
        return np.abs(self.coc_px)

    @property
    def relative_disparity(self) -> Float32:
        """True disparity from 0, the farthest point, to 1, the nearest (H, W) [1].

        The signed CoC is affine in disparity, so it is the disparity in another unit.
        """
        return relative_disparity(self.coc_px, self.coc_px)

    @property
    def scene_name(self) -> str:
        """The scene of a plate SCENE_FOCUS; a plate with no underscore is a scene of its own."""
        return self.name.rpartition("_")[0] or self.name


def relative_disparity(coc_px: Float32, plate_coc_px: Float32) -> Float32:
    """Disparity on a scale from 0, a plate's farthest point, to 1, its nearest [1].

    Args:
        coc_px: signed CoC of any shape, which is affine in disparity [px].
        plate_coc_px: that of the whole plate, nan where it is not known [px].
    """
    low, high = float(np.nanmin(plate_coc_px)), float(np.nanmax(plate_coc_px))
    return np.asarray((coc_px - low) / max(high - low, 1e-6), dtype=np.float32)


def find_plates(folder: Path) -> tuple[list[Path], list[str]]:
    """Folders of plates in a folder, and names of those that hold a plate's parts only.

    Raises:
        InputError: no such folder, no plate in it, or one that lacks a file.
    """
    plates = find_folders(folder, "plate", MARK, _PARTS)
    candidates = [folder, *sorted(folder.iterdir())]
    return plates, [
        path.name for path in candidates if path not in plates and (path / "bg_coc.npy").is_file()
    ]


def find_folders(folder: Path, kind: str, mark: str, parts: Sequence[str]) -> list[Path]:
    """Folders that hold `mark`: the folder itself and those in it, by name.

    Args:
        folder: where they are.
        kind: what they are, in words.
        mark: file or folder by which they are known.
        parts: what each must hold beside it.

    Raises:
        InputError: no such folder, none in it, or one that lacks a part.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with a folder for each {kind}")
    try:
        found = [path for path in (folder, *sorted(folder.iterdir())) if (path / mark).exists()]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror})") from error
    if not found:
        raise InputError(
            f"{folder}: no {kind} in it; expected folders with {mark}, {', '.join(parts)}"
        )
    for path in (path / part for path in found for part in parts):
        if not path.exists():
            raise InputError(f"{path}: no such file; each {kind} needs it")
    return found


def load_plate(folder: Path) -> Plate:
    """Read one plate.

    Raises:
        InputError: a file cannot be read or does not fit the others.
        SceneError: the GLB cannot be used.
    """
    rgb = _picture(folder / "bg.png")
    height, width = shape = rgb.shape[:2]
    coc_px = _array(folder / "bg_coc.npy", shape)
    if np.isnan(coc_px).all():
        raise InputError(f"{folder / 'bg_coc.npy'}: holds no number; expected the plate's CoC")
    depth = _array(folder / "object_depth.npz", shape, key="depth")
    object_coc_px = _array(folder / MARK, shape)
    scene = Scene.load(folder / "object.glb")
    vertices, faces = scene.pose(0.0).triangles()
    triangles = vertices.astype(np.float64)[faces]
    plate = Plate(
        folder=folder,
        rgb=rgb,
        coc_px=coc_px,
        sharp=_sharp(folder, shape),
        camera=scene.camera(0.0, width, height),
        scene=scene,
        triangles=triangles,
        ground_y=_ground(folder / "params.json", float(triangles[:, :, 1].min())),
        alpha=read_codes(folder / "object_rgba.png", shape, rgba=True)[..., 3],
        object_depth=np.nan_to_num(depth),
        object_coc_px=np.nan_to_num(object_coc_px),
        there=(depth > 0) & (depth < _FARTHEST) & np.isfinite(object_coc_px),
    )
    if not plate.solid.any():
        raise InputError(
            f"{folder}: its object covers no pixel wholly whose depth and CoC are known; expected "
            "one in view"
        )
    return plate


def read_codes(path: Path, size: tuple[int, int] | None = None, *, rgba: bool = False) -> UInt8:
    """Code values (H, W, 3 or 4) of an 8-bit RGB or RGBA picture.

    Args:
        path: the file.
        size: rows and columns that it must have [px].
        rgba: whether it must have an alpha channel.

    Raises:
        InputError: it cannot be read as that.
    """
    if not path.is_file():  # OpenCV warns by itself
        raise InputError(f"{path}: no such file")
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    channels = (4,) if rgba else (3, 4)
    if (
        raw is None or raw.ndim != 3 or raw.dtype != np.uint8 or raw.shape[2] not in channels
        or (size is not None and raw.shape[:2] != size)
    ):  # fmt: skip
        kind = "RGBA" if rgba else "RGB or RGBA"
        wanted = f" of {size[1]}x{size[0]}" if size else ""
        raise InputError(f"{path}: cannot be read as an 8-bit {kind} picture{wanted}")
    return np.ascontiguousarray(raw[..., [2, 1, 0, 3][: raw.shape[2]]], np.uint8)


def _picture(path: Path, size: tuple[int, int] | None = None) -> Float32:
    """RGB in [0, 1] (H, W, 3) of an 8-bit picture."""
    return read_codes(path, size)[..., :3].astype(np.float32) / np.float32(255)


def _array(path: Path, shape: tuple[int, int], key: str | None = None) -> Float32:
    """A float map (H, W); infinity, as nan, is a value that is not known."""
    try:
        loaded = np.load(path, allow_pickle=False)
        values = np.asarray(loaded if key is None else loaded[key], dtype=np.float32)
    except (OSError, ValueError, KeyError, IndexError, EOFError) as error:
        raise InputError(f"{path}: cannot be read as a numpy array ({error})") from error
    if values.shape != shape:
        raise InputError(f"{path}: shape {values.shape}, expected the picture's {shape}")
    return np.where(np.isfinite(values), values, np.float32(np.nan))


def _sharp(folder: Path, shape: tuple[int, int]) -> Float32 | None:
    """The pinhole picture; one is kept for all plates SCENE_FOCUS of a scene."""
    scene, _, focus = folder.name.rpartition("_")
    siblings = sorted(folder.parent.glob(f"{scene}_*/bg_sharp.png")) if scene and focus else []
    for path in (folder / "bg_sharp.png", *siblings):
        if path.is_file():
            return _picture(path, shape)
    return None


def _ground(path: Path, lowest: float) -> float:
    """Height of the ground, the object's lowest point where the file does not say."""
    try:
        described = json.loads(path.read_text())
        value = float(described.get("ground_plane_y_gltf", lowest))
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: cannot be read as a plate's description ({error})") from error
    if not np.isfinite(value):
        raise InputError(f"{path}: ground_plane_y_gltf is {value}, expected a height")
    return value
