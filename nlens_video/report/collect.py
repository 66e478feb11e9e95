"""Gathers what the report shows while a run goes by, and writes the page at its end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from nlens_video.core.errors import OutputError
from nlens_video.core.layers import DefocusedLayer
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.executor import FrameState
from nlens_video.report.downsampling import EvenPick, TimingBins
from nlens_video.report.findings import Findings, Shown, StripFrame
from nlens_video.report.pictures import Image, copied, shown, thumbnail
from nlens_video.video.atomic_files import remove_stale, replacing

if TYPE_CHECKING:
    from nlens_video.graph.session import Session
    from nlens_video.video.info import SourceInfo

PAGE = "index.html"
STRIP_FRAMES = 12


class Report:
    """`--report`: an `Observer` that leaves `folder/index.html` when the run has finished.

    Memory does not grow with the clip. Plates are copied only until the frame that is shown at
    length has come by, and each copy goes when its frame is written. `entering` may be called on
    another thread than the rest.

    Args:
        folder: of the page; made where it is missing.
        info: the source.
        session: what the run is made of.
        output: what the run writes, as the user gave it.

    Raises:
        OutputError: the folder cannot be made.
    """

    def __init__(self, folder: Path, info: SourceInfo, session: Session, output: str) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"{folder}: cannot be made ({error.strerror}); give --report a writable folder"
            ) from error
        self.what = f"--report {folder}"
        self._path = folder / PAGE
        remove_stale(self._path)
        self._info = info
        self._session = session
        self._output = output
        finds_lens = any(node.once for node in session.graph.nodes)
        self._awaits_fit = finds_lens and session.executor.fit is None
        self._lock = threading.Lock()
        self._plates: dict[int, Callable[[], Image]] = {}
        self._shown: Shown | None = None
        self._strip: EvenPick[StripFrame] = EvenPick(room=2 * STRIP_FRAMES)
        self._bins = TimingBins()
        self._warm_up: FrameTiming | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._plates.clear()

    def on_frame_start(self, state: FrameState) -> None:
        """Copy the plate, as long as it may be the one that is shown."""
        if self._shown is not None or (self._awaits_fit and self._session.executor.fit is not None):
            return
        plate = copied(state.frame.picture)
        with self._lock:
            self._plates[state.frame.index] = plate

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Keep what the page needs of a frame that is done."""
        with self._lock:
            plate = self._plates.pop(state.frame.index, None)
        composited, layer = state.composited, state.values.defocused
        due = state.carried_fit if self._awaits_fit else composited
        if due and plate is not None and self._shown is None:
            self._shown = Shown(
                index=state.frame.index,
                time_s=state.frame.time_s,
                before=plate(),
                after=shown(state.frame.picture.srgb()) if composited else None,
                defocused=layer,
            )
        if composited and self._strip.next_is_wanted():
            self._strip.keep(_strip_frame(state, layer))
        if state.carried_fit:
            self._warm_up = timing
        else:
            self._bins.add(timing)

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
            shown=self._shown,
            strip=tuple(self._strip.picked(STRIP_FRAMES)),
            bins=tuple(self._bins.bins),
            bin_width=self._bins.width,
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


def _strip_frame(state: FrameState, layer: DefocusedLayer | None) -> StripFrame:
    picture = state.frame.picture
    return StripFrame(
        index=state.frame.index,
        time_s=state.frame.time_s,
        jpeg=thumbnail(picture),
        size=(picture.width, picture.height),
        largest_coc_px=None if layer is None else layer.largest_coc_px,
    )
