"""What was found of things that move in a shot, as a file: other runs of the shot need not look.

A run that reads it composites the same bits as the run that found it.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box
from nlens_video.effects.finding import Finding
from nlens_video.effects.foreground.background import Background, SmallBackground
from nlens_video.effects.foreground.canvas import Canvas, StillCanvas
from nlens_video.effects.foreground.looks import Look
from nlens_video.effects.foreground.tracks import Ordered
from nlens_video.effects.foreground.travelled_canvas import TravelledCanvas
from nlens_video.effects.foreground.turned_canvas import TurnedCanvas
from nlens_video.graph.foreground_matte import MovingForeground
from nlens_video.scene.camera import Camera

Arrays = dict[str, npt.NDArray[Any]]
_NUMBERS = ("fx", "fy", "cx", "cy", "width", "height")


def write_foreground(path: Path, found: MovingForeground | None, finding: Finding) -> None:
    """Write what was found.

    Args:
        path: the file.
        found: what moves, None where nothing does.
        finding: why.
    """
    arrays: Arrays = {"finding": np.array(json.dumps(asdict(finding)))}
    if found is not None:
        arrays |= _canvas_arrays(found.canvas) | _things_arrays(found)
        for prefix, part in (("small", found.small), ("background", found.background)):
            for one in fields(part):
                value = getattr(part, one.name)
                arrays[f"{prefix}.{one.name}"] = np.array(
                    _corners(value) if isinstance(value, Box) else value
                )
    with path.open("wb") as file:
        np.savez(file, **cast("dict[str, Any]", arrays))


def read_foreground(path: Path) -> tuple[MovingForeground | None, Finding]:
    """What was written.

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
    small = {one.name: arrays[f"small.{one.name}"] for one in fields(SmallBackground)}
    width, height = small.pop("size").tolist()
    things, cameras = _things(arrays)
    return MovingForeground(
        canvas=_canvas(arrays),
        small=SmallBackground(size=(width, height), **small),
        background=Background(
            box=Box(*arrays["background.box"].tolist()), roots=arrays["background.roots"],
            noise=arrays["background.noise"],
        ),
        things=things, cameras=cameras,
    )  # fmt: skip


def _corners(box: Box) -> tuple[int, int, int, int]:
    return box.x0, box.y0, box.x1, box.y1


def _canvas_arrays(canvas: Canvas) -> Arrays:
    if isinstance(canvas, TravelledCanvas):
        return {"canvas.relief": canvas.relief.disparity, **_canvas_arrays(canvas.turned)}
    if not isinstance(canvas, TurnedCanvas):
        return {"canvas.size": np.array(canvas.size)}
    return {
        "canvas.size": np.array(canvas.frame),
        "canvas.pose": canvas.camera.world_from_camera,
        "canvas.numbers": _numbers(canvas.camera),
        "canvas.distortion_k1": np.array(canvas.distortion_k1),
    }


def _canvas(arrays: Arrays) -> Canvas:
    width, height = arrays["canvas.size"].tolist()
    if "canvas.pose" not in arrays:
        return StillCanvas((width, height))
    turned = TurnedCanvas(
        camera=_camera(arrays["canvas.pose"], arrays["canvas.numbers"]), frame=(width, height),
        distortion_k1=float(arrays["canvas.distortion_k1"]),
    )  # fmt: skip
    if "canvas.relief" not in arrays:
        return turned
    return TravelledCanvas.of(turned, arrays["canvas.relief"])


def _numbers(camera: Camera) -> npt.NDArray[np.float64]:
    return np.array([getattr(camera, name) for name in _NUMBERS], np.float64)


def _camera(pose: npt.NDArray[Any], numbers: npt.NDArray[Any]) -> Camera:
    fx, fy, cx, cy, width, height = numbers.tolist()
    return Camera(
        world_from_camera=pose, fx=fx, fy=fy, cx=cx, cy=cy, width=int(width), height=int(height)
    )


def _things_arrays(found: MovingForeground) -> Arrays:
    """A row for each thing on a frame, one for each frame's camera, and the looks once."""
    rows = [(frame, one) for frame, things in found.things.items() for one in things]
    looks = list({id(one.look): one.look for _, one in rows}.values())
    number = {id(look): at for at, look in enumerate(looks)}
    cameras = list(found.cameras.values())
    return {
        "things.frame": np.array([frame for frame, _ in rows], np.int64),
        "things.box": np.array([_corners(one.box) for _, one in rows], np.int64).reshape(-1, 4),
        "things.region": np.array([_corners(one.region) for _, one in rows], np.int64).reshape(
            -1, 4
        ),
        "things.numbers": np.array(
            [(one.before, one.disparity, one.moved_px) for _, one in rows], np.float64
        ).reshape(-1, 3),
        "things.look": np.array([number[id(one.look)] for _, one in rows], np.int64),
        "looks": np.array([look.counts for look in looks], np.float32),
        "looks.shape": np.array([look.shape for look in looks], np.float32),
        "cameras.frame": np.array(list(found.cameras), np.int64),
        "cameras.pose": np.array([one.world_from_camera for one in cameras]),
        "cameras.numbers": np.array([_numbers(one) for one in cameras]),
    }


def _things(arrays: Arrays) -> tuple[dict[int, tuple[Ordered, ...]], dict[int, Camera]]:
    looks = [
        Look(counts, shape)
        for counts, shape in zip(arrays["looks"], arrays["looks.shape"], strict=True)
    ]
    things: dict[int, tuple[Ordered, ...]] = {}
    for frame, box, region, numbers, look in zip(
        *(
            arrays[f"things.{name}"].tolist()
            for name in ("frame", "box", "region", "numbers", "look")
        ),
        strict=True,
    ):
        before, disparity, moved = numbers
        one = Ordered(Box(*box), Box(*region), before, disparity, moved, looks[look])
        things[frame] = (*things.get(frame, ()), one)
    cameras = {
        frame: _camera(pose, numbers)
        for frame, pose, numbers in zip(
            arrays["cameras.frame"].tolist(), arrays["cameras.pose"], arrays["cameras.numbers"],
            strict=True,
        )
    }  # fmt: skip
    return things, cameras
