"""Check whether the GLB's camera zooms as the plate does."""

from __future__ import annotations

import math
from threading import Lock

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.errors import Note, NoteKind
from nlens_video.core.layers import Float32, Picture
from nlens_video.graph.base.profiler import FrameTiming
from nlens_video.graph.executor import FrameState, Observer
from nlens_video.run.checks.breathing import Breathing
from nlens_video.run.checks.pace import Pace
from nlens_video.scene.camera import Camera
from nlens_video.solve.tracks import luma_of

_SOON_S, _LATE_S = 0.25, 1.0  # between measured frames, where the scale changes and where not [s]
_RESTS = 1e-3  # change of the scale between two measured frames that is none [1]
_TOLERATED = 0.03  # of the size: what the tracker is off by is less, a visible zoom more
_AT_REST = 1e-3  # of the distance to the object: a moving camera also changes sizes


class ZoomCheck(Observer):
    """An `Observer` that compares the plate's scale with the camera's focal length.

    Frames on which the GLB's camera has moved are not compared.

    Args:
        frame_s: frame interval [s].
    """

    def __init__(self, frame_s: float) -> None:
        super().__init__()
        self._pace = Pace(frame_s, _SOON_S, _LATE_S)
        self._before: Zoom | None = None
        self._tracker = ZoomTracker()
        self._lock = Lock()
        self._seen: dict[int, Zoom] = {}
        self._first: tuple[Camera, Zoom] | None = None
        self._worst: tuple[float, float, int] | None = None  # plate, camera, frame
        self._breathing, self._breathed = Breathing(), ""

    @property
    def notes(self) -> tuple[str, ...]:
        """A note on a lens that breathes, or on the largest difference; empty where both agree."""
        breathing = self._breathed or self._breathing.describe()
        if breathing:
            return (Note(breathing, NoteKind.INFORMATION),)
        if self._worst is None:
            return ()
        plate, camera, index = self._worst
        return (
            Note(
                f"by frame {index} the plate has {_scale_text(plate)} and the GLB's camera has "
                f"{_scale_text(camera)}: animate its field of view as the plate's zoom goes (or "
                "its place, if the real camera moved)",
                NoteKind.INFORMATION,
            ),
        )

    def on_frame_start(self, state: FrameState) -> None:
        """Measure the plate."""
        if not self._pace.due(state.frame.index):
            return
        zoom = self._tracker(state.frame.picture)
        before, self._before = self._before, zoom
        rests = (
            before is not None
            and before.shot == zoom.shot
            and abs(zoom.log_scale - before.log_scale) < _RESTS
        )
        self._pace.looked(state.frame.index, rests=rests)
        with self._lock:
            self._seen[state.frame.index] = zoom

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Compare with the camera of that frame, where the object is in view."""
        with self._lock:
            zoom = self._seen.pop(state.frame.index, None)
            for late in [index for index in self._seen if index < state.frame.index]:
                del self._seen[late]  # of dropped frames
        placement = state.values.bounds
        if zoom is None or placement is None:
            return
        if self._first is None or self._first[1].shot != zoom.shot:
            self._first = placement.camera, zoom
            self._breathed = self._breathed or self._breathing.describe()
            self._breathing = Breathing()
            self._see_focus(state, 0.0)
            return
        camera, before = self._first
        if _moved(camera, placement.camera) > _AT_REST * placement.nearest:
            return
        plate = zoom.log_scale - before.log_scale
        own = math.log(placement.camera.fx / camera.fx)
        self._see_focus(state, plate - own)
        worst = 0.0 if self._worst is None else abs(self._worst[0] - self._worst[1])
        if abs(plate - own) > max(worst, _TOLERATED):
            self._worst = plate, own, state.frame.index

    def _see_focus(self, state: FrameState, log_size: float) -> None:
        fit = state.values.fit
        if fit is not None and fit.slope > 0.0:
            self._breathing.add(fit.focus_disparity, log_size)


def _moved(before: Camera, now: Camera) -> float:
    """Distance between two camera positions [scene unit]."""
    return float(np.linalg.norm((now.world_from_camera - before.world_from_camera)[:3, 3]))


def _scale_text(log_scale: float) -> str:
    percent = round(100.0 * abs(math.expm1(log_scale)))
    if not percent:
        return "kept its size"
    return f"{'grown' if log_scale > 0 else 'shrunk'} by {percent} %"


_WIDTH = 240  # of the picture that is tracked [px]
_POINTS, _FEWEST = 80, 24  # tracked points, at most and at least
_QUALITY, _SPACING_PX = 0.01, 6
_WINDOW_PX, _LEVELS = 21, 3
_WITHIN_PX = 1.0  # inlier distance of a point from the common similarity transform


class Zoom(Struct, frozen=True):
    """The plate's scale on one frame relative to the first of its shot.

    Attributes:
        log_scale: logarithm of the ratio, above 0 where things have grown [1].
        shot: number of the segment in which points are tracked; scales of two are unrelated [1].
    """

    log_scale: float
    shot: int


class ZoomTracker:
    """Scale of a plate by sparse optical flow (Lucas-Kanade) and a similarity fit.

    Called with frames in order, not necessarily each. When too few points are left, new ones are
    detected and the scale continues from there; where tracking fails (a cut, a plate without
    detail), a new segment begins.
    """

    def __init__(self) -> None:
        self._before: npt.NDArray[np.uint8] | None = None
        self._first: Float32 = np.empty((0, 1, 2), np.float32)  # points (N, 1, 2) [px]
        self._now: Float32 = self._first
        self._log_scale = self._since = 0.0
        self._shot = 0

    def __call__(self, picture: Picture) -> Zoom:
        """Track one frame."""
        width = min(_WIDTH, picture.width)
        seen = luma_of(picture, (width, max(1, round(picture.height * width / picture.width))))
        if self._before is not None and not self._follow(self._before, seen):
            self._shot += 1
            self._log_scale = 0.0
            self._detect(seen)
        if len(self._now) < _FEWEST * 2:
            self._log_scale += self._since
            self._detect(seen)
        self._before = seen
        return Zoom(self._log_scale + self._since, self._shot)

    def _detect(self, seen: npt.NDArray[np.uint8]) -> None:
        found = cv2.goodFeaturesToTrack(seen, _POINTS, _QUALITY, _SPACING_PX)
        empty = np.empty((0, 1, 2), np.float32)
        self._first = self._now = empty if found is None else np.asarray(found, np.float32)
        self._since = 0.0

    def _follow(self, before: npt.NDArray[np.uint8], seen: npt.NDArray[np.uint8]) -> bool:
        """Track the points and update the scale since detection; False where they are lost."""
        if len(self._now) < _FEWEST:
            return False
        moved, held, _ = cv2.calcOpticalFlowPyrLK(
            before,
            seen,
            self._now,
            self._now.copy(),
            winSize=(_WINDOW_PX, _WINDOW_PX),
            maxLevel=_LEVELS,
        )
        kept = held[:, 0] == 1
        first, now = self._first[kept], moved[kept]
        if len(now) < _FEWEST:
            return False
        matrix, fits = cv2.estimateAffinePartial2D(
            first, now, ransacReprojThreshold=_WITHIN_PX, maxIters=200
        )
        if matrix is None or fits.sum() < _FEWEST:
            return False
        self._first, self._now = first[fits[:, 0] == 1], now[fits[:, 0] == 1]
        self._since = float(np.log(max(np.hypot(matrix[0, 0], matrix[1, 0]), 1e-6)))
        return True
