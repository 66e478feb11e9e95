"""File of the moving foreground of a shot, so that other runs of the shot need not search for it.

A run that reads it composites the same bits as the run that wrote it. The names of the arrays are
fixed: the file of a farm, or of a run that was interrupted, may be older than the code.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from msgspec.structs import asdict

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box
from nlens_video.effects.finding import Finding
from nlens_video.effects.foreground.appearance import AppearanceModel
from nlens_video.effects.foreground.background import BackgroundModel, CleanPlate
from nlens_video.effects.foreground.parallax_view import ParallaxView
from nlens_video.effects.foreground.reference_view import ReferenceView, StaticView
from nlens_video.effects.foreground.rotation_view import RotationView
from nlens_video.effects.foreground.tracker import TrackState
from nlens_video.graph.foreground_matte import MovingForeground
from nlens_video.scene.camera import Camera

Arrays = dict[str, npt.NDArray[Any]]
_INTRINSICS = ("fx", "fy", "cx", "cy", "width", "height")


def write_foreground(path: Path, found: MovingForeground | None, finding: Finding) -> None:
    """Write the result of `find_moving_foreground`.

    Args:
        path: the file.
        found: what moves, None where nothing does.
        finding: why.
    """
    arrays: Arrays = {"finding": np.array(json.dumps(asdict(finding)))}
    if found is not None:
        arrays |= _reference_arrays(found.reference) | _state_arrays(found)
        for prefix, part in (("small", found.model), ("background", found.clean_plate)):
            for name in part.__struct_fields__:
                value = getattr(part, name)
                arrays[f"{prefix}.{name}"] = np.array(
                    _corners(value) if isinstance(value, Box) else value
                )
    with path.open("wb") as file:
        np.savez(file, **cast("dict[str, Any]", arrays))


def read_foreground(path: Path) -> tuple[MovingForeground | None, Finding]:
    """The result that was written.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        finding = Finding(**json.loads(str(arrays["finding"])))
        return (_found(arrays) if "small.roots" in arrays else None), finding
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: cannot be read ({error}); remove it") from error


def _found(arrays: Arrays) -> MovingForeground:
    model = {name: arrays[f"small.{name}"] for name in BackgroundModel.__struct_fields__}
    width, height = model.pop("size").tolist()
    states, cameras = _states(arrays)
    return MovingForeground(
        reference=_reference(arrays),
        model=BackgroundModel(size=(width, height), **model),
        clean_plate=CleanPlate(
            box=Box(*arrays["background.box"].tolist()), roots=arrays["background.roots"],
            noise=arrays["background.noise"],
        ),
        states=states, cameras=cameras,
    )  # fmt: skip


def _corners(box: Box) -> tuple[int, int, int, int]:
    return box.x0, box.y0, box.x1, box.y1


def _reference_arrays(reference: ReferenceView) -> Arrays:
    if isinstance(reference, ParallaxView):
        depth = {"canvas.relief": reference.depth.disparity}
        return {**depth, **_reference_arrays(reference.rotation)}
    if not isinstance(reference, RotationView):
        return {"canvas.size": np.array(reference.size)}
    return {
        "canvas.size": np.array(reference.frame_size),
        "canvas.pose": reference.camera.world_from_camera,
        "canvas.numbers": _intrinsics(reference.camera),
        "canvas.distortion_k1": np.array(reference.distortion_k1),
    }


def _reference(arrays: Arrays) -> ReferenceView:
    width, height = arrays["canvas.size"].tolist()
    if "canvas.pose" not in arrays:
        return StaticView((width, height))
    rotation = RotationView(
        camera=_camera(arrays["canvas.pose"], arrays["canvas.numbers"]), frame_size=(width, height),
        distortion_k1=float(arrays["canvas.distortion_k1"]),
    )  # fmt: skip
    if "canvas.relief" not in arrays:
        return rotation
    return ParallaxView.from_disparity(rotation, arrays["canvas.relief"])


def _intrinsics(camera: Camera) -> npt.NDArray[np.float64]:
    return np.array([getattr(camera, name) for name in _INTRINSICS], np.float64)


def _camera(pose: npt.NDArray[Any], intrinsics: npt.NDArray[Any]) -> Camera:
    fx, fy, cx, cy, width, height = intrinsics.tolist()
    return Camera(
        world_from_camera=pose, fx=fx, fy=fy, cx=cx, cy=cy, width=int(width), height=int(height)
    )


def _state_arrays(found: MovingForeground) -> Arrays:
    """A row for each target on a frame, one for each camera, one for each appearance model."""
    rows = [(frame, one) for frame, states in found.states.items() for one in states]
    appearances = list({id(one.appearance): one.appearance for _, one in rows}.values())
    number = {id(one): i for i, one in enumerate(appearances)}
    cameras = list(found.cameras.values())
    return {
        "things.frame": np.array([frame for frame, _ in rows], np.int64),
        "things.box": np.array([_corners(one.box) for _, one in rows], np.int64).reshape(-1, 4),
        "things.region": np.array([_corners(one.blob_box) for _, one in rows], np.int64).reshape(
            -1, 4
        ),
        "things.numbers": np.array(
            [(one.in_front, one.disparity, one.displacement_px) for _, one in rows], np.float64
        ).reshape(-1, 3),
        "things.look": np.array([number[id(one.appearance)] for _, one in rows], np.int64),
        "looks": np.array([one.histogram for one in appearances], np.float32),
        "looks.shape": np.array([one.silhouette for one in appearances], np.float32),
        "looks.count": np.array([one.samples for one in appearances], np.int64),
        "cameras.frame": np.array(list(found.cameras), np.int64),
        "cameras.pose": np.array([one.world_from_camera for one in cameras]),
        "cameras.numbers": np.array([_intrinsics(one) for one in cameras]),
    }


def _states(arrays: Arrays) -> tuple[dict[int, tuple[TrackState, ...]], dict[int, Camera]]:
    # files of earlier versions have no counts
    counts = arrays.get("looks.count", np.ones(len(arrays["looks"]), np.int64)).tolist()
    appearances = [
        AppearanceModel(histogram, silhouette, count)
        for histogram, silhouette, count in zip(
            arrays["looks"], arrays["looks.shape"], counts, strict=True
        )
    ]
    states: dict[int, tuple[TrackState, ...]] = {}
    for frame, box, blob_box, numbers, i in zip(
        *(
            arrays[f"things.{name}"].tolist()
            for name in ("frame", "box", "region", "numbers", "look")
        ),
        strict=True,
    ):
        in_front, disparity, moved = numbers
        one = TrackState(Box(*box), Box(*blob_box), in_front, disparity, moved, appearances[i])
        states[frame] = (*states.get(frame, ()), one)
    cameras = {
        frame: _camera(pose, intrinsics)
        for frame, pose, intrinsics in zip(
            arrays["cameras.frame"].tolist(), arrays["cameras.pose"], arrays["cameras.numbers"],
            strict=True,
        )
    }  # fmt: skip
    return states, cameras
