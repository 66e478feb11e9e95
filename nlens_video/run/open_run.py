"""Opening a run: source, lookahead and session from the settings."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.files import read_camera
from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.settings import Settings, SourceSettings
from nlens_video.effects.foreground.survey import StaticCameraSurvey
from nlens_video.effects.measurement import MOST_PICTURES
from nlens_video.graph.base.context import ReadAgain
from nlens_video.graph.base.followed_lens import followed_distortion
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.executor import FrameState, Observer
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.graph.scheduler import run_in_thread
from nlens_video.graph.session import LensPasses, Session, open_session
from nlens_video.run.frame_range import ChunkRange, FrameRange, SourceSlice, look_ahead
from nlens_video.run.lens_request import lens_request
from nlens_video.run.plate_source import frame_s, length_s, opened
from nlens_video.scene.scene import Scene
from nlens_video.stages.r_samples import FitSamples
from nlens_video.video.chunk_queue import ChunkFeed
from nlens_video.video.focal_length import tagged_focal
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.input.seek import SeekableSource
from nlens_video.video.interfaces import Source

if TYPE_CHECKING:
    import av

    Packet = av.Packet[Any]


_SHORT = 3000  # most frames of a file that is read as a whole for a part of it


class ShotPasses(Struct, frozen=True):
    """What passes over a file tell before a run.

    Attributes:
        lens: waits for what they tell of the lens.
        survey: waits for what was seen of what moves in the shot, None where nobody looked.
        under_way: whether they are still under way.
    """

    lens: Callable[[], LensPasses] = LensPasses
    survey: Callable[[], StaticCameraSurvey | None] = lambda: None
    under_way: bool = False


_NO_PASSES = ShotPasses()


class RunInput(Struct, frozen=True):
    """An open source and the graph for its frames.

    Attributes:
        source: the plate.
        frames: its frames and packets.
        session: the graph.
        profiler: times the run.
        lookahead_allowed: whether the frame that fits the lens may wait for later frames.
    """

    source: Source
    frames: Iterator[SourceFrame | Packet]
    session: Session
    profiler: Profiler
    lookahead_allowed: bool

    @property
    def info(self) -> SourceInfo:
        """What is known about the source."""
        return self.source.info

    def items(self, observers: Sequence[Observer]) -> Iterator[FrameState | Packet]:
        """Frames as the graph takes them, and packets, in the source's order."""
        executor = self.session.executor
        waits = self.lookahead_allowed and executor.graph.has("estimate-coc")
        for item, following in look_ahead(self.frames, lambda: waits and executor.fit is None):
            if not isinstance(item, SourceFrame):
                yield item
                continue
            if self.info.kind == "stream":
                self.profiler.arrived(item.index)
            state = executor.begin_frame(item, following)
            for observer in observers:
                observer.on_frame_start(state)
            yield state

    def may_drop(self, item: object) -> bool:
        """Whether a late item may be dropped: frames may, packets not. Counts dropped frames."""
        if isinstance(item, FrameState):
            self.profiler.drop(item.frame.index)
        return isinstance(item, FrameState)


@contextmanager
def open_run(
    settings: Settings, profiler: Profiler, others: tuple[FitSamples, ...] = ()
) -> Iterator[RunInput]:
    """Open the source and build the graph for it; the source closes at the end.

    Args:
        settings: the run.
        profiler: times the run.
        others: samples of other frames for the lens fit.

    Raises:
        NlensError: as `run.render`.
    """
    with opened(settings.source) as source:
        yield build_run_input(
            source, settings, profiler, ShotPasses(lambda: LensPasses(others=others))
        )


def build_run_input(
    source: Source,
    settings: Settings,
    profiler: Profiler,
    passes: ShotPasses = _NO_PASSES,
    *,
    chunks: ChunkFeed | None = None,
    scene: Scene | None = None,
) -> RunInput:
    """Build the graph for a source that is open.

    Args:
        source: the plate; no frame of it has been read yet.
        settings: the run.
        profiler: times the run.
        passes: what is known of the shot beforehand; waited for once the plate's first frames are
            measured and read.
        chunks: frames to render in place of the settings' range.
        scene: the objects' files, where they are loaded already.

    Raises:
        NlensError: as `run.render`.
    """
    if settings.late == "drop" and source.info.kind != "stream":
        raise UsageError(
            f"--on-late drop: {source.info.name} is a {source.info.kind}, which drops no frames; "
            "leave it out, or pipe the plate in"
        )
    frames = (
        FrameRange(source, settings.source.frames) if chunks is None else ChunkRange(source, chunks)
    )
    session = _assembled(settings, source.info, profiler, frames, passes, scene)
    frames.on_skipped = session.executor.observe_skipped
    if isinstance(source, SeekableSource) and not session.graph.stateful:
        frames.skip_to = source.skip_to
    return RunInput(
        source,
        _decoded(frames, profiler, live=source.info.kind == "stream"),
        session,
        profiler,
        # chunks come with their lens, and the next chunk may be far away or not queued yet
        lookahead_allowed=chunks is None and _may_wait(source.info),
    )


def _assembled(
    settings: Settings,
    info: SourceInfo,
    profiler: Profiler,
    frames: SourceSlice,
    passes: ShotPasses,
    scene: Scene | None,
) -> Session:
    lens = lens_request(settings, info)
    most = MOST_PICTURES if _may_wait(info) else 1
    again = None if settings.output is None else read_again(settings.source, info)
    plate = PlatePreview(
        lambda: run_in_thread(lambda: frames.peek(most)),
        settings.source.frames[0],
        again,
        passes.survey,
        begins_run=settings.source.frames[0] == 0 and passes.under_way,
        from_start=read_again(replace(settings.source, frames=(0, None)), info),
    )
    view = view_of(settings, info)
    return open_session(
        settings.scene, lens, view, profiler, plate, passes=passes.lens, scene=scene
    )


def read_again(given: SourceSettings, info: SourceInfo) -> ReadAgain | None:
    """Reads the shot, None where it is no file.

    All of it, whatever the range, so that a range equals the whole; of a long file up to the end of
    the range.
    """
    end = given.frames[1]
    if not _may_wait(info) or not can_be_read_again(given.spec):
        return None
    last = end if (info.frame_count or 0) > _SHORT else None

    def again(*, sparse: bool = False) -> Iterator[SourceFrame]:
        with opened(replace(given, frames=(0, None)), sparse=sparse) as source:
            for frame in takewhile(lambda frame: last is None or frame.index < last, source):
                signals.check()
                yield frame

    return again


def view_of(settings: Settings, info: SourceInfo) -> View:
    """How the plate's frames see the scene.

    Raises:
        SceneError: the file of its camera cannot be used.
    """
    file = settings.scene.camera_from
    size = info.width, info.height
    focal, solved = tagged_focal(info), None
    if file is not None:
        solved = read_camera(file, size, info.average_rate, info.time_base, info.pixel_aspect)
    simulated = load_pipeline(settings.preset).effects
    return View(
        frame_s=frame_s(info),
        length_s=length_s(info),
        width=info.width,
        height=info.height,
        pixel_aspect=info.pixel_aspect,
        camera=settings.scene.camera,
        focal_35mm=None if focal is None else focal.equivalent_mm,
        solved=solved,
        distortion=followed_distortion(settings.effects, simulated, settings.optics, solved),
    )


def _may_wait(info: SourceInfo) -> bool:
    """Whether later frames may be waited for, which would delay a live stream."""
    return info.kind in ("video", "sequence")


def _decoded(
    frames: SourceSlice, profiler: Profiler, *, live: bool
) -> Iterator[SourceFrame | Packet]:
    """The source's items; the profiler gets the decoding time of each frame.

    Waiting for a live source does not count: a camera of 30 frames a second would use up a budget
    of 33 ms by itself, and `--hold-budget` would lower the quality without a reason.
    """
    items = frames.items()
    now = time.thread_time if live else time.perf_counter
    spent_ms = 0.0  # includes packets before the frame
    while True:
        start = now()
        item = next(items, None)
        spent_ms += 1e3 * (now() - start)
        if item is None:
            return
        if isinstance(item, SourceFrame):
            profiler.add(item.index, "decode", spent_ms)
            spent_ms = 0.0
        yield item
