"""The plug-in for OpenCV, PyAV and numpy loops: frames in, composited frames out."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, NoReturn, Self, TypeVar

from nlens_video.aperture import Aperture, as_aperture
from nlens_video.effects.planner import requested_effects
from nlens_video.errors import UsageError
from nlens_video.graph.ahead import Ahead
from nlens_video.graph.asked_lens import Lens
from nlens_video.graph.assemble import Assembly, assemble
from nlens_video.graph.call_for import Plate
from nlens_video.graph.objects import View
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.graph.profiler import Profiler, Summary
from nlens_video.graph.stream import LoopFrame
from nlens_video.lens import LensFit
from nlens_video.loop_arguments import as_fit, as_moment, check_settings
from nlens_video.loop_frames import Frames, as_format_of, given_back, taken
from nlens_video.optics import NOTHING_SAID, Optics
from nlens_video.settings import Fallback, ObjectSettings

if TYPE_CHECKING:
    import av

    from nlens_video.frames import Picture
    from nlens_video.notebook import Shown

R = TypeVar("R")


class Compositor:
    """Puts an animated object into frames, one at a time.

    The lens is fitted on the first frame with the object in view and kept. All work happens on one
    thread of the compositor's own (OpenGL lives there), so it can be called from any thread;
    frames are processed in the order of the calls. A process that was forked from the one that made
    it is refused: each makes its own.

    Args:
        glb: the animated object, with a perspective camera; or `settings.ObjectSettings`, which
            also say where it stands (`placing`) and which animation plays (`playback`).
        preset: shipped pipeline's name or path of a pipeline file.
        fps: frames per second, for frames that come without a time [1/s].
        effects: as `--effects`: `auto`, `all`, `none`, names, or `auto,+shadow,-grain`.
        fit: the lens, when it is known beforehand; a fit or the path of a saved one.
        ground_y: height of the ground plane, None for the object's lowest point [scene unit].
        camera: name of the GLB's camera, None for its first.
        fallback: `constant` lets a constant CoC stand in for a fit that fails.
        budget_ms: what a frame may cost [ms].
        shutter_deg: how long the shutter is open, 360 for all of a frame, None if not known [deg].
        track_focus: `auto` follows a lens that changes, `off` keeps the first fit.
        aperture: its shape, as `--aperture` takes it or an `aperture.Aperture`.
        cat_eye: how much a cat's eye narrows it towards the corners, 0 to 1 [radius].
        optics: what is known of the lens beside its focus: vignetting, distortion.

    Raises:
        UsageError: an argument makes no sense.
        LensFitError: the saved fit cannot be read.
        SceneError: the GLB cannot be used; raised at the first frame.
    """

    def __init__(  # noqa: PLR0913  the command line's options, by name
        self,
        glb: str | Path | ObjectSettings,
        *,
        preset: str = "standard",
        fps: float = 30.0,
        effects: str = "auto",
        fit: LensFit | str | Path | None = None,
        ground_y: float | None = None,
        camera: str | None = None,
        fallback: Fallback = "none",
        budget_ms: float = 180.0,
        shutter_deg: float | None = None,
        track_focus: Literal["auto", "off"] = "auto",
        aperture: Aperture | str = "round",
        cat_eye: float = 0.0,
        optics: Optics = NOTHING_SAID,
    ) -> None:
        check_settings(fps=fps, budget_ms=budget_ms, fallback=fallback, track_focus=track_focus)
        load_pipeline(preset)  # both speak up here rather than at the first frame
        requested_effects(effects)
        fit = None if fit is None else as_fit(fit)
        if not isinstance(glb, ObjectSettings):
            glb = ObjectSettings(glb=Path(glb), camera=camera, ground_y=ground_y)
        elif camera is not None or ground_y is not None:
            raise UsageError("camera and ground_y stand in the ObjectSettings; leave them out")
        self._objects = glb
        self._lens = Lens(
            preset=preset, effects=effects, fit=fit, fallback=fallback, frame_s=1.0 / fps,
            shutter_deg=shutter_deg, aperture=as_aperture(aperture, cat_eye), optics=optics,
            live=track_focus == "auto",
        )  # fmt: skip
        self._fps = fps
        self._profiler = Profiler(budget_ms)
        self._assembly: Assembly | None = None
        self._size: tuple[int, int] | None = None
        self._first_s: float | None = None
        self._count = 0
        self._closed = False
        self._gate = threading.Lock()
        self._last: Picture | None = None
        self._process = os.getpid()
        self._stack = ExitStack()
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="nlens-compositor")

    def process(self, frame: Frames, time: float | None = None) -> Frames:
        """Composite one frame.

        Args:
            frame: (H, W, 3) BGR or (H, W, 4) BGRA as OpenCV gives it, or (H, W) grey; uint8,
                uint16, float32 or float16 in [0, 1]; or a torch tensor of that shape and type, or
                of bfloat16; left as it is.
            time: moment of the animation [s]; default: frames so far / fps.

        Returns:
            A new array (or a tensor on the same device) of the same shape, type and channel order.

        Raises:
            InputError: a shape or type that no picture has, or floats of another range.
            UsageError: neither array nor tensor, another size than before, no moment.
            SceneError: the GLB cannot be used.
            LensFitError: no usable lens fit.
        """
        from nlens_video.video.picture import ArrayPicture

        result, moment = taken(frame), as_moment(time)
        self._call(lambda: self._composite(ArrayPicture(result), moment))
        return given_back(result, frame)

    def process_av(self, frame: av.VideoFrame) -> av.VideoFrame:
        """Composite one of PyAV's frames; format, pts and colour tags stay as they are.

        The animation's moment is the frame's own time since the first frame, where it has one.

        Args:
            frame: left as it is.

        Returns:
            A new frame.

        Raises:
            InputError: a format that cannot be composited in.
            SceneError: the GLB cannot be used.
            LensFitError: no usable lens fit.
        """
        from nlens_video.video.picture import AvPicture, copied

        if type(frame).__name__ != "VideoFrame":
            raise UsageError(f"process_av takes PyAV's frames, not {type(frame).__name__}")
        picture = AvPicture(copied(frame))
        self._call(lambda: self._composite(picture, self._since_first(frame)))
        return as_format_of(picture.frame, frame)

    def stream(self, frames: Iterable[Frames]) -> Iterator[Frames]:
        """Composite frames as they come, PyAV's too; a generator that holds one at a time."""
        for frame in frames:
            made: Any = self.process_av if type(frame).__name__ == "VideoFrame" else self.process
            yield made(frame)

    @property
    def fit(self) -> LensFit | None:
        """The lens, once found or given."""
        if self._assembly is None or self._assembly.steps.fit is None:
            return self._lens.fit
        return self._assembly.steps.fit

    @fit.setter
    def fit(self, fit: LensFit) -> None:
        """Take another lens from the next frame on, and follow no change of it any more."""
        fit = as_fit(fit)

        def take() -> None:
            self._lens = replace(self._lens, fit=fit)
            if self._assembly is not None and self._size is not None:
                self._assembly.steps.hold(fit.for_width(*self._size))

        self._call(take)

    def swap(self, glb: str | Path | ObjectSettings) -> None:
        """Composite another object from the next frame on; the lens is held, time goes on.

        Args:
            glb: as at the beginning; a path keeps camera and ground height as they were given.

        Raises:
            SceneError: the GLB cannot be used; raised at the next frame.
        """
        if not isinstance(glb, ObjectSettings):
            glb = replace(self._objects, glb=Path(glb))
        objects = glb

        def take() -> None:
            self._lens = replace(self._lens, fit=self.fit)
            self._stack.close()
            self._objects, self._assembly = objects, None

        self._call(take)

    def show(self) -> Shown:
        """The last composite, the lens and what runs, as a notebook draws them."""
        from nlens_video.notebook import show

        return self._call(lambda: show(self._last, self.fit, self.plan))

    @property
    def plan(self) -> tuple[str, ...]:
        """What runs on each frame and why, a line each; empty before the first frame."""
        if self._assembly is None:
            return ()
        from nlens_video.graph.plan import describe

        return tuple(describe(self._assembly))

    @property
    def timings(self) -> Summary:
        """The frames so far in a few numbers."""
        return self._profiler.summary()

    def close(self) -> None:
        """Free OpenGL, networks and the thread; harmless when repeated."""
        if os.getpid() != self._process:  # its thread, and OpenGL, are the other process's
            return
        with self._gate:
            freed = None if self._closed else self._worker.submit(self._stack.close)
            self._closed = True
        if freed is not None:
            freed.result()
        self._worker.shutdown()

    def __reduce__(self) -> NoReturn:
        raise UsageError("a compositor cannot be sent to another process; make one in each")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _call(self, work: Callable[[], R]) -> R:
        if os.getpid() != self._process:
            raise UsageError("the compositor was made by another process; make one in each")
        with self._gate:  # nothing gets in between the last frame and the freeing
            if self._closed:
                raise UsageError("the compositor is closed; make a new one")
            asked = self._worker.submit(work)
        return asked.result()

    def _since_first(self, frame: av.VideoFrame) -> float | None:
        if frame.time is None:
            return None
        if self._first_s is None:
            self._first_s = frame.time
        return frame.time - self._first_s

    def _composite(self, picture: Picture, time: float | None) -> None:
        assembly = self._assembled(picture)
        steps = assembly.steps
        moment = self._count / self._fps if time is None else time
        state = steps.enter(LoopFrame(self._count, moment, picture))
        steps.run(state, assembly.graph.nodes)
        self._last = picture
        self._profiler.close_frame(self._count, self._count, warm_up=state.carried_fit)
        self._count += 1

    def _assembled(self, picture: Picture) -> Assembly:
        size = (picture.width, picture.height)
        if self._assembly is None:
            view = View(width=size[0], height=size[1], camera=self._objects.camera)
            self._assembly = assemble(
                self._objects, self._lens, view, self._profiler, Plate(lambda: (picture,))
            )
            self._stack.enter_context(self._assembly.render_context())
            self._stack.enter_context(Ahead(self._assembly.graph))
            self._size = size
        if size != self._size:
            raise UsageError(
                f"a frame of {size[0]}x{size[1]} after frames of {self._size}: one compositor "
                "takes one size; make another for other frames"
            )
        return self._assembly
