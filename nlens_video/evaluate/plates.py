"""Plates with known lens: a folder each, rendered with true depth of field.

A plate is a folder that holds `object_coc.npy`, and beside it `bg.png`, `bg_coc.npy`, `object.glb`,
`object_depth.npz`, `object_rgba.png` and `params.json`; `bg_sharp.png` where it is at hand.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene

MARK = "object_coc.npy"
_PARTS = (
    "bg.png",
    "bg_coc.npy",
    "object.glb",
    "object_depth.npz",
    "object_rgba.png",
    "params.json",
)
_FARTHEST = 1e4  # object depths beyond this mean "nothing there" [scene unit]
_SOLID = 250  # alpha codes above this belong to the object alone


@dataclass(frozen=True, slots=True, kw_only=True)
class Plate:
    """A plate, its true CoC, and the object that is to be put into it.

    Attributes:
        name: name of its folder.
        rgb: the plate, display-coded sRGB in [0, 1] (H, W, 3).
        coc_px: true signed CoC diameter (H, W) [px].
        sharp: the same view through a pinhole (H, W, 3), None where it was not rendered.
        camera: the virtual camera, which is the true one.
        triangles: the object's triangles in the world (T, 3, 3) [scene unit].
        ground_y: height of the plane on which it stands [scene unit].
        object_depth: camera-space depth of the sharp object (H, W) [scene unit].
        object_coc_px: true signed CoC diameter of it (H, W) [px].
        solid: pixels that the sharp object covers wholly and whose depth is known (H, W).
    """

    name: str
    rgb: Float32
    coc_px: Float32
    sharp: Float32 | None
    camera: Camera
    triangles: Float64
    ground_y: float
    object_depth: Float32
    object_coc_px: Float32
    solid: Bool

    @property
    def true_coc_px(self) -> Float32:
        """True CoC diameter without its sign (H, W) [px]."""
        return np.abs(self.coc_px)

    @property
    def relative_disparity(self) -> Float32:
        """True disparity from 0, the farthest point, to 1, the nearest (H, W) [1].

        The signed CoC is affine in disparity, so it is the disparity in another unit.
        """
        return self.relative(self.coc_px)

    def relative(self, coc_px: Float32) -> Float32:
        """The disparity of signed CoC [px] of any shape on the scale of `relative_disparity`."""
        return relative_disparity(coc_px, self.coc_px)

    @property
    def scene(self) -> str:
        """The scene of a plate SCENE_FOCUS; a plate with no underscore is a scene of its own."""
        return self.name.rpartition("_")[0] or self.name


def relative_disparity(coc_px: Float32, plate_coc_px: Float32) -> Float32:
    """Disparity on a scale from 0, a plate's farthest point, to 1, its nearest [1].

    Args:
        coc_px: signed CoC of any shape, which is affine in disparity [px].
        plate_coc_px: that of the whole plate [px].
    """
    low, high = float(plate_coc_px.min()), float(plate_coc_px.max())
    return np.asarray((coc_px - low) / max(high - low, 1e-6), dtype=np.float32)


def find_plates(folder: Path) -> tuple[list[Path], list[Path]]:
    """Folders of plates in a folder, and those passed over because they hold a plate's parts only.

    Raises:
        InputError: no such folder, no plate in it, or one that lacks a file.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with a folder for each plate")
    try:
        inside = sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror})") from error
    candidates = [folder, *inside]
    plates = [path for path in candidates if (path / MARK).is_file()]
    if not plates:
        raise InputError(
            f"{folder}: no plate in it; expected folders with {MARK}, {', '.join(_PARTS)}"
        )
    for plate in plates:
        for part in _PARTS:
            if not (plate / part).is_file():
                raise InputError(f"{plate / part}: no such file; each plate needs it")
    passed = [path for path in candidates if path not in plates and (path / "bg_coc.npy").is_file()]
    return plates, passed


def load_plate(folder: Path) -> Plate:
    """Read one plate.

    Raises:
        InputError: a file cannot be read or does not fit the others.
        SceneError: the GLB cannot be used.
    """
    rgb = _picture(folder / "bg.png")[..., :3]
    height, width = rgb.shape[:2]
    shape = (height, width)
    depth = _array(folder / "object_depth.npz", shape, key="depth")
    alpha = _picture(folder / "object_rgba.png")
    if alpha.shape != (*shape, 4):
        raise InputError(
            f"{folder / 'object_rgba.png'}: shape {alpha.shape}, expected {(*shape, 4)}"
        )
    scene = Scene.load(folder / "object.glb")
    vertices, faces = scene.pose(0.0).triangles()
    triangles = vertices.astype(np.float64)[faces]
    known = np.isfinite(depth) & (depth > 0) & (depth < _FARTHEST)
    solid = known & (alpha[..., 3] > _SOLID / 255)
    if not solid.any():
        raise InputError(f"{folder}: its object covers no pixel wholly; expected one in view")
    return Plate(
        name=folder.name,
        rgb=rgb,
        coc_px=_array(folder / "bg_coc.npy", shape),
        sharp=_sharp(folder, shape),
        camera=scene.camera(0.0, width, height),
        triangles=triangles,
        ground_y=_ground(folder / "params.json", float(triangles[:, :, 1].min())),
        object_depth=depth,
        object_coc_px=_array(folder / MARK, shape),
        solid=solid,
    )


def _picture(path: Path) -> Float32:
    """RGB or RGBA in [0, 1] (H, W, C) of an 8-bit picture."""
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if raw is None or raw.ndim != 3 or raw.dtype != np.uint8 or raw.shape[2] not in (3, 4):
        raise InputError(f"{path}: cannot be read as an 8-bit RGB or RGBA picture")
    swapped = raw[..., [2, 1, 0, 3][: raw.shape[2]]]
    return np.asarray(swapped, dtype=np.float32) / np.float32(255)


def _array(path: Path, shape: tuple[int, int], key: str | None = None) -> Float32:
    """A float map (H, W); what is not a number becomes 0."""
    try:
        loaded = np.load(path, allow_pickle=False)
        values = np.asarray(loaded if key is None else loaded[key], dtype=np.float32)
    except (OSError, ValueError, KeyError, IndexError, EOFError) as error:
        raise InputError(f"{path}: cannot be read as a numpy array ({error})") from error
    if values.shape != shape:
        raise InputError(f"{path}: shape {values.shape}, expected the picture's {shape}")
    return np.nan_to_num(values)


def _sharp(folder: Path, shape: tuple[int, int]) -> Float32 | None:
    """The pinhole picture; one is kept for all plates SCENE_FOCUS of a scene."""
    scene, _, focus = folder.name.rpartition("_")
    siblings = sorted(folder.parent.glob(f"{scene}_*/bg_sharp.png")) if scene and focus else []
    for path in (folder / "bg_sharp.png", *siblings):
        if path.is_file():
            picture = _picture(path)[..., :3]
            if picture.shape[:2] != shape:
                raise InputError(f"{path}: {picture.shape[:2]} px, expected the plate's {shape}")
            return picture
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
