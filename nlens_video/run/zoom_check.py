"""Looks on whether the GLB's camera zooms as the plate does."""

from __future__ import annotations

import math
from threading import Lock

import numpy as np

from nlens_video.graph.executor import FrameState
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.graph.profiler import FrameTiming
from nlens_video.run.observers import Watching
from nlens_video.run.zoom_watch import WatchZoom, Zoom
from nlens_video.scene.camera import Camera

_EVERY_S = 0.5
_TOLERATED = 0.03  # of the size; a zoom is seen from there on, and breathing of the focus is less
_AT_REST = 1e-3  # of the way to the object: a camera that moves on makes things larger as well


class ZoomCheck(Watching):
    """An `Observer` that compares the plate's size with the camera's focal length.

    Where the GLB's camera moves nothing is said, for then the plate grows by right.

    Args:
        frame_s: from one frame to the next [s].
    """

    def __init__(self, frame_s: float) -> None:
        self._every = max(1, round(_EVERY_S / frame_s)) if frame_s > 0 else 1
        self._watch = WatchZoom()
        self._lock = Lock()
        self._seen: dict[int, Zoom] = {}
        self._first: tuple[Camera, Zoom] | None = None
        self._worst: tuple[float, float, int] | None = None  # plate, camera, frame

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know; empty where both agree."""
        if self._worst is None:
            return ()
        plate, camera, index = self._worst
        return (
            f"by frame {index} the plate has {_words(plate)} and the GLB's camera has "
            f"{_words(camera)}: animate its field of view as the plate's zoom goes (or its place, "
            "if the real camera moved)",
        )

    def entering(self, state: FrameState) -> None:
        """Look at the plate."""
        if state.frame.index % self._every:
            return
        zoom = self._watch(state.frame.picture)
        with self._lock:
            self._seen[state.frame.index] = zoom

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Compare with the camera of that frame, where the object is in view."""
        with self._lock:
            zoom = self._seen.pop(state.frame.index, None)
            for late in [index for index in self._seen if index < state.frame.index]:
                del self._seen[late]  # frames that were left out
        placement = state.values.get("placement")
        if zoom is None or not isinstance(placement, Placement):
            return
        if self._first is None or self._first[1].shot != zoom.shot:
            self._first = placement.camera, zoom
            return
        camera, before = self._first
        if _moved(camera, placement.camera) > _AT_REST * placement.nearest:
            return
        plate = zoom.log_scale - before.log_scale
        own = math.log(placement.camera.fx / camera.fx)
        worst = 0.0 if self._worst is None else abs(self._worst[0] - self._worst[1])
        if abs(plate - own) > max(worst, _TOLERATED):
            self._worst = plate, own, state.frame.index


def _moved(before: Camera, now: Camera) -> float:
    """Way between two places [scene unit]."""
    return float(np.linalg.norm((now.world_from_camera - before.world_from_camera)[:3, 3]))


def _words(log_scale: float) -> str:
    percent = round(100.0 * abs(math.expm1(log_scale)))
    if not percent:
        return "kept its size"
    return f"{'grown' if log_scale > 0 else 'shrunk'} by {percent} %"
