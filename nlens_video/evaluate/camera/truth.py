"""Plates with a known camera: stills with a known lens, and clips of a camera that moves.

A still is a folder with `params.json` (`view_matrix_gltf`, `yfov_rad`, `ground_plane_y_gltf`) and
`bg.png`, or `bg.mp4` where the camera films for a while and stays. A clip has `bg.mp4` and in
`params.json` a `view_matrix_gltf` for each of its `frames`, `hfov_deg` and `ground_points`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from msgspec import Struct

from nlens_video.cameras.solved import CameraKey, SolvedCamera, rigid_matrix
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit

MARK = "params.json"
PICTURE, CLIP = "bg.png", "bg.mp4"
STILL = "still"


class Known(Struct, frozen=True, kw_only=True, eq=False):
    """A plate and its true camera.

    Attributes:
        name: path of its folder from the one that is evaluated.
        folder: of its files.
        plate: what the camera is to be solved from.
        kind: the motion in one word, `still` for none.
        camera: the true camera, metres, of each frame; of a still one entry.
        ground_points: points of the ground to follow in a clip (N, 3) [m].
        lens: the true lens of a still, where the file says it.
    """

    name: str
    folder: Path
    plate: Path
    kind: str
    camera: SolvedCamera
    ground_points: Float64
    lens: LensFit | None


def find_known(folder: Path) -> list[Known]:
    """Plates with a known camera: the folder itself and those in it at any depth, by name.

    Links are followed; a plate that is found twice is taken once.

    Raises:
        InputError: no such folder, no plate with a known camera in it, or one that cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one with a folder for each plate")
    found = [_known(path, folder) for path in _described(folder)]
    known = [one for one in found if one is not None]
    if not known:
        raise InputError(
            f"{folder}: no plate with a known camera in it; expected folders with {MARK} (a "
            f"view_matrix_gltf) and {PICTURE} or {CLIP}"
        )
    return known


def _described(root: Path) -> Iterator[Path]:
    """Folders that hold a description, each place once."""
    seen: set[Path] = set()
    for name, folders, files in os.walk(root, followlinks=True):
        folder = Path(name)
        place = folder.resolve()
        if place in seen:
            folders.clear()
            continue
        seen.add(place)
        folders.sort()
        if MARK in files:
            yield folder


def _known(folder: Path, root: Path) -> Known | None:
    """The plate of a folder, None where its description knows no camera or it has no picture."""
    path = folder / MARK
    try:
        raw = json.loads(path.read_text())
        if not isinstance(raw, dict):
            return None
        frames = raw.get("frames")
        moves = isinstance(frames, list) and bool(frames) and "view_matrix_gltf" in frames[0]
        if not moves and "view_matrix_gltf" not in raw:
            return None
        plate = folder / (CLIP if moves or not (folder / PICTURE).is_file() or frames else PICTURE)
        if not plate.is_file():
            return None
        camera = _moving(raw) if moves else _still(raw)
        points = np.array(raw.get("ground_points", []), np.float64).reshape(-1, 3)
        if moves and not len(points):
            raise ValueError("no ground_points")
        lens = None if moves else _lens(raw, camera)
        kind = str(raw.get("kind", folder.name)) if moves else STILL
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: cannot be read as a known camera ({error})") from error
    name = folder.relative_to(root).as_posix() if folder != root else folder.resolve().name
    return Known(
        name=name, folder=folder, plate=plate, kind=kind, camera=camera, ground_points=points,
        lens=lens,
    )  # fmt: skip


def _still(raw: Mapping[str, object]) -> SolvedCamera:
    width, height = _size(raw)
    half = 0.5 * _number(raw["yfov_rad"])
    fov = 2.0 * math.degrees(math.atan(math.tan(half) * width / height))
    return SolvedCamera(
        width=width, height=height, keys=(_key(0, 0.0, raw["view_matrix_gltf"], fov),),
        ground_y=_number(raw.get("ground_plane_y_gltf", 0.0)), scale="metres",
    )  # fmt: skip


def _moving(raw: Mapping[str, object]) -> SolvedCamera:
    width, height = _size(raw)
    fov, rate, frames = _number(raw["hfov_deg"]), _number(raw["fps"]), raw["frames"]
    assert isinstance(frames, list)
    keys = (_key(n, n / rate, frame["view_matrix_gltf"], fov) for n, frame in enumerate(frames))
    return SolvedCamera(
        width=width, height=height, keys=tuple(keys), path="moving", scale="metres",
        ground_y=_number(raw.get("ground_y", 0.0)),
    )  # fmt: skip


def _key(index: int, pts_s: float, matrix: object, fov_x_deg: float) -> CameraKey:
    rigid = rigid_matrix(matrix)
    if rigid is None or not 0.0 < fov_x_deg < 180.0:
        raise ValueError(f"frame {index} has no rigid view_matrix_gltf and field of view")
    return CameraKey(index=index, pts_s=pts_s, world_to_camera=rigid, fov_x_deg=fov_x_deg)


def _lens(raw: Mapping[str, object], camera: SolvedCamera) -> LensFit | None:
    """The lens, None where the file says none: coc = coc_at_infinity (focus / depth - 1)."""
    if "coc_at_infinity_px" not in raw or "focus_distance_m" not in raw:
        return None
    infinity, focus = _number(raw["coc_at_infinity_px"]), _number(raw["focus_distance_m"])
    return LensFit(
        slope=infinity * focus, intercept=-infinity, width=camera.width, height=camera.height
    )


def _size(raw: Mapping[str, object]) -> tuple[int, int]:
    size = raw["resolution"]
    if not isinstance(size, list) or len(size) != 2 or not all(_number(side) >= 1 for side in size):
        raise ValueError(f"resolution is {size!r:.40}, expected columns and rows")
    return int(size[0]), int(size[1])


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r:.40} is no number")
    return float(value)
