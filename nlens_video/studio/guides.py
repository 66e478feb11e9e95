"""Where object, horizon and ground are on a frame, for what the page draws over the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.cameras.placement import contact_point
from nlens_video.core.layers import Float64
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.view import View
from nlens_video.report.ground_grid import Grid, horizon_row, part_in_view
from nlens_video.report.svg import nice_step
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene

_CELLS = 6  # of the ground grid each way
_FAR = 20.0  # frames: what lies farther out is not drawn


@dataclass(frozen=True, slots=True, kw_only=True)
class Guides:
    """Places on a frame, in fractions of its width and height from its upper left corner.

    Attributes:
        at: where the object touches the ground, None where that is behind the camera.
        size: rows from there up to its highest point [frame height].
        outline: left, upper, right and lower border of the object.
        horizon: rows of the horizon at the left and the right border, None where there is none.
        grid: lines on the ground, each as two points.
        placed: whether the shot places the object; else a camera of its file does.
        keyed: whether the object can be placed on this frame: its camera is known there.
        moving: whether the plate's camera moves.
    """

    at: tuple[float, float] | None
    size: float
    outline: tuple[float, float, float, float] | None
    horizon: tuple[float, float] | None
    grid: tuple[tuple[float, float, float, float], ...]
    placed: bool
    keyed: bool
    moving: bool


def guides(objects: ObjectSettings, scene: Scene, view: View, index: int, time_s: float) -> Guides:
    """What is where on a frame.

    Args:
        objects: the object and its place.
        scene: its file.
        view: with the camera that sees it.
        index: of the frame.
        time_s: of the frame [s].
    """
    camera = view.camera_at(scene, time_s)
    vertices = scene.pose(0.0).vertices().astype(np.float64)
    contact = contact_point(scene.pose(0.0).vertices(), objects.ground_y)
    at, size = _stand(camera, contact, vertices)
    moved = scene.pose(time_s).vertices().astype(np.float64)
    keys = () if view.solved is None else view.solved.keys
    tall = float(np.ptp(vertices[:, 1])) or 1.0
    return Guides(
        at=at,
        size=size,
        outline=_outline(camera, moved),
        horizon=_horizon(camera),
        grid=tuple(_grid(camera, Grid(contact, nice_step(tall), _CELLS))),
        placed=not scene.camera_names or bool(objects.placing or objects.on_ground),
        keyed=len(keys) < 2 or any(key.index == index for key in keys),
        moving=len(keys) > 1,
    )


def _stand(
    camera: Camera, contact: Float64, vertices: Float64
) -> tuple[tuple[float, float] | None, float]:
    seen = camera.to_camera(np.vstack([contact[None], vertices]))
    if not (seen[:, 2] < 0.0).all():
        return None, 0.0
    spots = camera.pixels(seen) / (camera.width, camera.height)
    if not (np.abs(spots[0]) < _FAR).all():
        return None, 0.0
    return (float(spots[0, 0]), float(spots[0, 1])), float(spots[0, 1] - spots[:, 1].min())


def _outline(camera: Camera, vertices: Float64) -> tuple[float, float, float, float] | None:
    seen = camera.to_camera(vertices)
    if not (seen[:, 2] < 0.0).all():
        return None
    spots = camera.pixels(seen) / (camera.width, camera.height)
    low, high = spots.min(axis=0), spots.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _horizon(camera: Camera) -> tuple[float, float] | None:
    rows = [horizon_row(camera, column) / camera.height for column in (0.0, camera.width)]
    if not all(abs(row) < _FAR for row in rows):
        return None
    return float(rows[0]), float(rows[1])


def _grid(camera: Camera, grid: Grid) -> list[tuple[float, float, float, float]]:
    found = []
    for line in grid.lines():
        ends = part_in_view(camera, grid, line)
        if ends is not None:
            first, last = (ends / (camera.width, camera.height)).clip(-_FAR, _FAR).tolist()
            found.append((first[0], first[1], last[0], last[1]))
    return found
