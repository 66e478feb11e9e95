"""Observer that collects the data of the report during a run and writes the page at its end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from msgspec.structs import replace

from nlens_video.core.errors import OutputError
from nlens_video.core.layers import Picture
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.executor import FrameState, Observer
from nlens_video.report.findings import EvenPick, Findings, MainFrame, StripFrame, TimingBins
from nlens_video.report.html import Image, jpeg, to_8_bit
from nlens_video.video.atomic_files import make_folder, remove_stale, replacing
from nlens_video.video.pixels import blend
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.samples import Axis, Samples

if TYPE_CHECKING:
    from nlens_video.graph.session import Session
    from nlens_video.video.info import SourceInfo

PAGE = "index.html"
STRIP_FRAMES = 12
_THUMBNAIL_PX, _THUMBNAIL_QUALITY = 320, 82


class Report(Observer):
    """`--report`: an `Observer` that leaves `folder/index.html` when the run has finished.

    Memory does not grow with the clip. Plates are copied only until the main frame has been
    written, and each copy is dropped when its frame is written. `on_frame_start` may be called on
    another thread than the rest.

    Args:
        folder: of the page; created if missing.
        info: the source.
        session: graph and fit of the run.
        output: what the run writes, as the user gave it.

    Raises:
        OutputError: the folder cannot be created.
    """

    def __init__(self, folder: Path, info: SourceInfo, session: Session, output: str) -> None:
        super().__init__()
        make_folder(folder, "give --report a writable folder")
        self.what = f"--report {folder}"
        self._path = folder / PAGE
        remove_stale(self._path)
        self._info = info
        self._session = session
        session.executor.shot.keeps_maps = True
        self._output = output
        finds_lens = any(node.once for node in session.graph.nodes)
        self._awaits_fit = finds_lens and session.executor.fit is None
        self._lock = threading.Lock()
        self._plates: dict[int, Callable[[], Image]] = {}
        self._stack.callback(self._plates.clear)
        self._main: MainFrame | None = None
        self._strip: EvenPick[StripFrame] = EvenPick(room=2 * STRIP_FRAMES)
        self._timings = TimingBins()
        self._warm_up: FrameTiming | None = None

    def on_frame_start(self, state: FrameState) -> None:
        """Copy the plate, as long as its frame may become the main one."""
        if self._main is not None or (self._awaits_fit and self._session.executor.fit is not None):
            return
        plate = copied(state.frame.picture)
        with self._lock:
            self._plates[state.frame.index] = plate

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Keep what the page shows of a finished frame."""
        frame, composited, layer = state.frame, state.composited, state.values.defocused
        with self._lock:
            plate = self._plates.pop(frame.index, None)
        due = state.fitted_here if self._awaits_fit else composited
        if due and plate is not None and self._main is None:
            self._main = MainFrame(
                index=frame.index,
                time_s=frame.time_s,
                before=plate(),
                after=to_8_bit(frame.picture.shown()) if composited else None,
                defocused=layer,
            )
        if composited and self._strip.next_is_wanted():
            self._strip.keep(
                StripFrame(
                    index=frame.index,
                    time_s=frame.time_s,
                    jpeg=thumbnail(frame.picture),
                    size=(frame.picture.width, frame.picture.height),
                    largest_coc_px=None if layer is None else layer.largest_coc_px,
                )
            )
        if state.fitted_here:
            self._warm_up = timing
        else:
            self._timings.add(timing)

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """Write the page.

        Raises:
            OutputError: it cannot be written.
        """
        from nlens_video.report.page import page

        findings = Findings(
            info=self._info,
            output=self._output,
            session=self._session,
            main=self._main,
            strip=self._strip.picked(STRIP_FRAMES),
            timings=self._timings,
            warm_up=self._warm_up,
            summary=summary,
            notes=notes,
        )
        text = page(findings)
        with replacing(self._path) as partial:
            try:
                partial.write_text(text, encoding="utf-8", errors="replace")  # names may be no text
            except OSError as error:
                raise OutputError(
                    f"{self._path}: cannot be written ({error.strerror}); free some space or give "
                    "--report another folder"
                ) from error


def copied(picture: Picture) -> Callable[[], Image]:
    """A copy of the picture as it is now, converted for the eye only when it is called for.

    Copying samples costs a five-hundredth of converting them, and most plates are never shown.
    """
    samples = _samples(picture)
    if samples is None:
        image = to_8_bit(picture.shown())
        return lambda: image
    y, u, v = (plane.copy() for plane in samples.planes)
    still = replace(samples, planes=(y, u, v))
    return lambda: to_8_bit(blend.shown(still))


def thumbnail(picture: Picture) -> bytes:
    """A small JPEG of the picture; converts no more pixels than it needs."""
    samples = _samples(picture)
    rgb = picture.shown() if samples is None else blend.shown(_reduced(samples))
    return jpeg(to_8_bit(rgb, _THUMBNAIL_PX), _THUMBNAIL_QUALITY)


def _samples(picture: Picture) -> Samples | None:
    """Views of a decoded frame's samples, None for pictures of other kinds."""
    return picture.samples() if isinstance(picture, AvPicture) else None


def _reduced(samples: Samples) -> Samples:
    """The samples averaged down to the width of a thumbnail, each component to the same size.

    Averaged codes are not averaged light, but converting a few pixels instead of all keeps the
    report cheap, and a thumbnail is not measured.
    """
    height, width = samples.planes[0].shape
    if width <= _THUMBNAIL_PX:
        return samples
    size = (_THUMBNAIL_PX, max(1, round(height * _THUMBNAIL_PX / width)))
    y, u, v = (
        cv2.resize(np.ascontiguousarray(plane), size, interpolation=cv2.INTER_AREA)
        for plane in samples.planes
    )
    return replace(samples, planes=(y, u, v), alpha=None, across=Axis(), down=Axis())
