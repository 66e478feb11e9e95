"""Check whether the object keeps its place on the plate's ground, as the camera has it."""

from __future__ import annotations

from threading import Lock

from nlens_video.core.errors import Note, NoteKind
from nlens_video.core.layers import Box, Float32
from nlens_video.graph.base.profiler import FrameTiming
from nlens_video.graph.executor import FrameState, Observer
from nlens_video.run.checks.pace import Pace
from nlens_video.scene.camera import Camera
from nlens_video.solve.ground_drift import GroundDrift, ground_seen, has_moved, seen_by_pinhole
from nlens_video.solve.tracks import Tracker, luma_of

_WIDTH = 360  # of the picture that is tracked [px]
_POINTS = 120
_SOON_S, _LATE_S = 0.08, 1.0  # between tracked frames, where points move and where they rest [s]
_RESTS_PX = 1.0  # step of the middle point between two tracked frames, where they rest


class DriftCheck(Observer):
    """An `Observer` that compares the plate's ground with the ground of the object's camera.

    Args:
        frame_s: frame interval, 0 for a still [s].
        ground_y: height of the object's ground [scene unit].
        solved: whether the camera is one of the plate's, solved or given.
        distortion_k1: of the plate's lens, which the object follows, as of `SolvedCamera` [1].
        ends_early: whether the camera does not last for all frames, which another note tells.
    """

    def __init__(
        self,
        frame_s: float,
        ground_y: float,
        *,
        solved: bool,
        distortion_k1: float = 0.0,
        ends_early: bool = False,
    ) -> None:
        super().__init__()
        self._pace = Pace(frame_s, _SOON_S, _LATE_S)
        self._ground_y = ground_y
        self._solved = solved
        self._distortion = distortion_k1
        self._ends_early = ends_early
        self._tracker = Tracker(most=_POINTS, recorded=False)
        self._drift = GroundDrift()
        self._camera: Camera | None = None
        self._camera_moves = False
        self._lock = Lock()
        self._seen: dict[int, dict[int, Float32]] = {}
        self._width = self._small = 0
        self._first = self._last = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """A warning with the drift; empty where the object keeps its place."""
        drift = self._drift
        if not self._small:
            return ()
        scale = self._width / self._small
        if not drift.slides(self._width, scale):
            return ()
        words = (
            f"by up to {scale * drift.worst_px:.0f} px over {self._last - self._first} frames "
            f"(rms {scale * drift.rms_px:.1f} px)"
        )
        if self._ends_early:
            text = (
                f"the object slides over the plate's ground {words}; give a camera of all frames "
                "of the run"
            )
        elif not self._camera_moves:
            remedy = "use another camera file" if self._solved else (
                "solve the plate's camera (nlens-video solve IN camera.json) and give it with "
                "--camera-from"
            )  # fmt: skip
            text = (
                f"the plate's camera moves and the object's does not: it slides {words}; {remedy}"
            )
        else:
            text = (
                f"the object's camera does not follow the plate's ground: it slides {words}; check "
                "the camera and --ground-y, or solve the camera with more of the ground in view"
            )
        return (Note(text, NoteKind.UNCERTAIN),)

    def on_frame_start(self, state: FrameState) -> None:
        """Track the plate."""
        index, picture = state.frame.index, state.frame.picture
        if not self._pace.soon or not self._pace.due(index):
            return
        self._width, self._small = picture.width, min(_WIDTH, picture.width)
        size = self._small, max(1, round(picture.height * self._small / picture.width))
        self._tracker.add(luma_of(picture, size))
        steps = self._tracker.steps_px
        self._pace.looked(index, rests=len(steps) > 1 and steps[-1] < _RESTS_PX)
        with self._lock:
            self._seen[index] = self._tracker.current

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Compare with the camera of that frame, where the object is in view."""
        index = state.frame.index
        with self._lock:
            points = self._seen.pop(index, None)
            for late in [one for one in self._seen if one < index]:
                del self._seen[late]  # of dropped frames
        bounds = state.values.bounds
        if points is None or bounds is None:
            return
        scale = self._small / self._width
        camera = bounds.camera.resized(self._small, max(1, round(bounds.camera.height * scale)))
        edges = (round(scale * edge) for edge in (
            bounds.box.x0, bounds.box.y0, bounds.box.x1, bounds.box.y1
        ))  # fmt: skip
        if self._camera is None:
            self._first = index
        self._last = index
        before, self._camera = self._camera or camera, camera
        self._camera_moves = self._camera_moves or has_moved(before, camera)
        seen = seen_by_pinhole(points, camera, self._distortion)
        self._drift.add(seen, Box(*edges), ground_seen(before, camera, self._ground_y))
