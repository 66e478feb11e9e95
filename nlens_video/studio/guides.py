"""Where objects, horizon and ground are on a frame, for what the page draws over the picture."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from nlens_video.cameras.placement import contact_point
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.view import View
from nlens_video.report.ground_grid import Grid, horizon_row, part_in_view
from nlens_video.report.svg import nice_step
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.studio.objects import FAR, ObjectGuides, object_guides

_CELLS = 6  # of the ground grid each way


class Guides(Struct, frozen=True, kw_only=True):
    """Places on a frame, in fractions of its width and height from its upper left corner.

    Attributes:
        objects: each object.
        horizon: rows of the horizon at the left and the right border, None where there is none.
        grid: lines on the ground, each as two points.
        keyed: whether objects can be placed on this frame: its camera is known there.
        moving: whether the plate's camera moves.
    """

    objects: tuple[ObjectGuides, ...]
    horizon: tuple[float, float] | None
    grid: tuple[tuple[float, float, float, float], ...]
    keyed: bool
    moving: bool


def guides(objects: ObjectSettings, scene: Scene, view: View, index: int, time_s: float) -> Guides:
    """What is where on a frame.

    Args:
        objects: the objects and their places.
        scene: their files, staged.
        view: with the camera that sees them.
        index: of the frame.
        time_s: of the frame [s].
    """
    camera = view.camera_at(scene, time_s)
    vertices = scene.only(0).pose(0.0).vertices()
    contact = contact_point(vertices, objects.ground_y)
    keys = () if view.solved is None else view.solved.keys
    tall = float(np.ptp(vertices[:, 1].astype(np.float64))) or 1.0
    return Guides(
        objects=object_guides(objects, scene, view, time_s),
        horizon=_horizon(camera),
        grid=tuple(_grid(camera, Grid(contact, nice_step(tall), _CELLS))),
        keyed=len(keys) < 2 or any(key.index == index for key in keys),
        moving=len(keys) > 1,
    )


def _horizon(camera: Camera) -> tuple[float, float] | None:
    rows = [horizon_row(camera, column) / camera.height for column in (0.0, camera.width)]
    if not all(abs(row) < FAR for row in rows):
        return None
    return float(rows[0]), float(rows[1])


def _grid(camera: Camera, grid: Grid) -> list[tuple[float, float, float, float]]:
    found = []
    for line in grid.lines():
        ends = part_in_view(camera, grid, line)
        if ends is not None:
            first, last = (ends / (camera.width, camera.height)).clip(-FAR, FAR).tolist()
            found.append((first[0], first[1], last[0], last[1]))
    return found
