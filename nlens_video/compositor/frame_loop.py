"""The compositor's loop over frames, and the thread that runs it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, TypeVar

from msgspec.structs import replace

from nlens_video.cameras.files import read_camera
from nlens_video.core.errors import UsageError
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.nodes.warm_up import WarmUp
from nlens_video.graph.session import Session, open_session
from nlens_video.stages.r_lens_track import FitTrack
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.memory_picture import MemoryPicture

if TYPE_CHECKING:
    import av

    from nlens_video.core.layers import Picture

R = TypeVar("R")


@dataclass(slots=True)
class FrameLoop:
    """Composites frames as they come; the first one builds the graph.

    Attributes:
        objects: the object.
        lens: how the lens is found and simulated.
        fps: frames per second, for frames that come without a time [1/s].
        pixel_aspect: width of a pixel by its height, for frames that come without one [1].
        profiler: times the nodes.
        last: the last composite.
    """

    objects: ObjectSettings
    lens: LensRequest
    fps: float
    pixel_aspect: float
    profiler: Profiler
    last: Picture | None = None
    _session: Session | None = None
    _size: tuple[int, int] | None = None
    _first_s: float | None = None
    _count: int = 0
    _index: int = 0
    _stack: ExitStack = field(default_factory=ExitStack)

    @property
    def fit(self) -> LensFit | None:
        """The lens of the last frame, once found or given."""
        known = self._known
        return known.at(self._index) if isinstance(known, FitTrack) else known

    @property
    def _known(self) -> LensFit | FitTrack | None:
        session = self._session
        return self.lens.fit if session is None else session.executor.track or session.executor.fit

    @property
    def seeks_lens(self) -> bool:
        """Whether a lens is neither known nor found yet, and something that runs finds one."""
        if self.fit is not None:
            return False
        return self._session is None or any(node.once for node in self._session.graph.nodes)

    @property
    def plan(self) -> tuple[str, ...]:
        """What runs on each frame and why, a line each; empty before the first frame."""
        if self._session is None:
            return ()
        from nlens_video.graph.session import describe

        return tuple(describe(self._session))

    def pin_fit(self, fit: LensFit | FitTrack) -> None:
        """Use another lens from the next frame on."""
        self.lens = replace(self.lens, fit=fit)
        if self._session is not None and self._size is not None:
            self._session.executor.pin_fit(fit.for_width(*self._size))

    def swap(self, objects: ObjectSettings) -> None:
        """Composite another object from the next frame on, through the same lens."""
        self.lens = replace(self.lens, fit=self._known)
        self._stack.close()
        self.objects, self._session = objects, None

    def since_first(self, frame: av.VideoFrame) -> float | None:
        """Time of one of PyAV's frames since the first one, None where it has none [s]."""
        if frame.time is None:
            return None
        if self._first_s is None:
            self._first_s = frame.time
        return frame.time - self._first_s

    def composite(
        self, picture: Picture, time: float | None, number: int | None = None,
        pixel_aspect: float | None = None,
    ) -> None:  # fmt: skip
        """Composite in place.

        Args:
            picture: the frame.
            time: of the animation; None: its number / fps [s].
            number: position of the frame in its stream; None: frames so far.
            pixel_aspect: width of a pixel by its height; that of the first frame counts; None: as
                it was given [1].
        """
        session = self._open(picture, pixel_aspect or self.pixel_aspect)
        self._index = index = self._count if number is None else number
        time_s = index / self.fps if time is None else time
        frame = SourceFrame(index=index, time_s=time_s, picture=picture)
        state = session.executor.begin_frame(frame)
        session.executor.run(state, session.graph.nodes)
        # another program's memory may be gone by the time that the last picture is shown
        self.last = None if isinstance(picture, MemoryPicture) else picture
        self.profiler.close_frame(index, index, warm_up=state.fitted_here)
        self._count += 1

    def close(self) -> None:
        """Free OpenGL and networks, and let go of the caller's memory."""
        self._stack.close()
        self.last = None

    def _open(self, picture: Picture, pixel_aspect: float) -> Session:
        size = (picture.width, picture.height)
        if self._session is None:
            file, rate = self.objects.camera_from, Fraction(self.fps).limit_denominator(1001)
            solved = None
            if file is not None:
                solved = read_camera(file, size, rate, pixel_aspect=pixel_aspect)
            view = View(
                width=size[0], height=size[1], pixel_aspect=pixel_aspect,
                camera=self.objects.camera, solved=solved, frame_s=1.0 / self.fps,
            )  # fmt: skip
            self._session = open_session(
                self.objects, self.lens, view, self.profiler, PlatePreview(lambda: (picture,))
            )
            self._stack.enter_context(self._session.render_context())
            self._stack.enter_context(WarmUp(self._session.nodes))
            self._size = size
        if self._size is not None and size != self._size:
            before = "{}x{}".format(*self._size)
            raise UsageError(
                f"a frame of {size[0]}x{size[1]} after frames of {before}: one compositor takes "
                "one size; make another for other frames"
            )
        return self._session


class OwnThread:
    """Runs calls from any thread on one worker thread, in their order.

    Args:
        free: called on the thread when it is closed.
    """

    def __init__(self, free: Callable[[], None]) -> None:
        self._free = free
        self._closed = False
        self._gate = threading.Lock()
        self._process = os.getpid()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="nlens-compositor")

    def call(self, work: Callable[[], R]) -> R:
        """Run a function there, and return its result.

        Raises:
            UsageError: the thread is closed, or belongs to another process.
        """
        if os.getpid() != self._process:
            raise UsageError("the compositor was made by another process; make one in each")
        with self._gate:  # no frame after `free`
            if self._closed:
                raise UsageError("the compositor is closed; make a new one")
            future = self._worker.submit(work)
        return future.result()

    def close(self) -> None:
        """Run `free` and end the thread; may be called again."""
        if os.getpid() != self._process:  # its thread, and OpenGL, are the other process's
            return
        with self._gate:
            freed = None if self._closed else self._worker.submit(self._free)
            self._closed = True
        if freed is not None:
            freed.result()
        self._worker.shutdown()
