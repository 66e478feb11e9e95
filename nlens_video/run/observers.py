"""Observers of a run: the saved fit, timing rows, EXR layers and the report."""

from __future__ import annotations

import json
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Protocol, Self

import numpy as np

from nlens_video.core.errors import OutputError
from nlens_video.core.layers import BlurredLayer, Box, Float32, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import OutputSettings, Settings
from nlens_video.graph.base.profiler import FrameTiming, Profiler, Summary
from nlens_video.graph.executor import FrameState
from nlens_video.graph.pipeline_file import FORMER_NAMES
from nlens_video.graph.session import Session
from nlens_video.video.atomic_files import check_folder, remove_stale, replacing
from nlens_video.video.exr import write_layers
from nlens_video.video.info import SourceInfo


@dataclass(frozen=True, slots=True)
class RunContext:
    """Source, session and profiler of a run that begins."""

    info: SourceInfo
    session: Session
    profiler: Profiler


class Observer(AbstractContextManager["Observer"], Protocol):
    """Is called for each frame of a run and changes nothing.

    Attributes:
        what: the option that asks for it and its value, for messages.
    """

    what: str

    def on_frame_start(self, state: FrameState) -> None:
        """A frame was decoded and nothing is composited yet; called on the decoding thread."""
        ...

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame was written."""
        ...

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """The last frame was written."""
        ...


def observers(
    settings: Settings, context: RunContext, output: OutputSettings | None
) -> list[Observer]:
    """The observers that the settings ask for.

    Args:
        settings: the run.
        context: its source and session.
        output: the result; None where that is the lens fit.

    Raises:
        OutputError: a folder or file cannot be made.
    """
    found: list[Observer] = []
    if settings.save_fit is not None and output is not None:
        found.append(SavedFit(settings.save_fit, context))
    if settings.timings is not None:
        found.append(TimingRows(settings.timings, settings, context))
    if settings.aov is not None:
        found.append(AovLayers(settings.aov, context))
    if settings.report is not None:
        from nlens_video.report.collect import Report

        written = output.spec if output is not None else str(settings.save_fit)
        found.append(Report(settings.report, context.info, context.session, written))
    return found


class BaseObserver:
    """An observer that does nothing."""

    what = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        return None

    def on_frame_start(self, state: FrameState) -> None:
        """Nothing to do."""

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Nothing to do."""

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """Nothing to do."""


class SavedFit(BaseObserver):
    """`--save-fit`: the lens fit, where there is one."""

    def __init__(self, path: Path, context: RunContext) -> None:
        check_folder(path)
        remove_stale(path)
        self.what = f"--save-fit {path}"
        self._path = path
        self._executor = context.session.executor

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """Write it."""
        if self._executor.fit is not None:
            save_fit(self._executor.fit, self._path)


def save_fit(fit: LensFit, path: Path) -> None:
    """Write a lens fit as JSON.

    Raises:
        OutputError: it cannot be written.
    """
    with replacing(path) as partial:
        partial.write_text(fit.to_json())


class TimingRows(BaseObserver):
    """`--timings`: one row per frame, written at once, so that memory does not grow.

    Under `aliases` stand the names before 1.0 of the nodes that ran: today's to the former one.
    """

    def __init__(self, path: Path, settings: Settings, context: RunContext) -> None:
        check_folder(path)
        remove_stale(path)
        self.what = f"--timings {path}"
        self._path = path
        self._stack = ExitStack()
        self._stream: IO[str] | None = None
        self._head = {
            "budget_ms": settings.budget_ms,
            "preset": context.session.graph.pipeline,
            "device": context.session.device.name,
        }
        self._rows = 0
        self._ran: set[str] = set()

    def __enter__(self) -> Self:
        partial = self._stack.enter_context(replacing(self._path))
        self._stream = self._stack.enter_context(partial.open("w"))
        head = json.dumps(self._head, indent=1)
        self._stream.write(head.rstrip("}\n") + ',\n "frames": [')
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Write the row."""
        assert self._stream is not None
        row = {
            "index": timing.index,
            "pts": timing.pts,
            "nodes": {name: round(ms, 3) for name, ms in timing.nodes.items()},
            "total_ms": round(timing.total_ms, 3),
            **({"rung": state.level} if state.level else {}),
        }
        self._stream.write(("," if self._rows else "") + "\n  " + json.dumps(row))
        self._rows += 1
        self._ran.update(timing.nodes)

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """Close the list, and give the file its name."""
        assert self._stream is not None
        tail = json.dumps({**asdict(summary), "fps": summary.fps})
        former = {new: old for old, new in FORMER_NAMES.items() if new in self._ran}
        self._stream.write(f'\n ],\n "aliases": {json.dumps(former)},\n "summary": {tail}\n}}\n')
        self._stack.close()


class AovLayers(BaseObserver):
    """`--aov`: the layers of each frame as multi-channel OpenEXR."""

    def __init__(self, folder: Path, context: RunContext) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"{folder}: cannot be made ({error}); give a writable folder"
            ) from error
        remove_stale(folder / "any.exr", whole_folder=True)
        self.what = f"--aov {folder}"
        self._folder = folder
        self._frame = Box(0, 0, context.info.width, context.info.height)
        self._executor = context.session.executor

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Write one file with the same channels on every frame, empty where there is no layer."""
        nothing = Box(0, 0, 0, 0)
        layer, defocused = state.values.layer, state.values.defocused
        blurred = state.values.blurred
        channels = self._plate()
        if layer is None:
            layer = ObjectLayer(box=nothing, rgba=_empty(4), depth=_empty())
        coc = defocused.coc_px if defocused is not None else 0 * layer.rgba[..., 3]
        if blurred is None:
            blurred = BlurredLayer(box=nothing, rgba=_empty(4))
        for at, name in enumerate("RGBA"):
            channels[f"object.{name}"] = self._on_frame(layer.box, layer.rgba[..., at], 0.0)
            channels[name] = self._on_frame(blurred.box, blurred.rgba[..., at], 0.0)
        channels["object.Z"] = self._on_frame(layer.box, layer.depth, np.inf)
        channels["object.coc_px"] = self._on_frame(layer.box, coc, 0.0)
        write_layers(self._folder / f"{state.frame.number:06d}.exr", channels)

    def _plate(self) -> dict[str, Float32]:
        """Plate CoC and footprint of the fit; zero until it is made, and where it was given."""
        size = (self._frame.height, self._frame.width)
        coc, ground = self._executor.shot.plate_coc, self._executor.shot.ground
        none = np.zeros(size, np.float32)
        return {
            "plate.coc_px": coc.coc_px if coc else none,
            "plate.sigma_px": coc.sigma_px if coc else none,
            "projection.mask": ground.mask.astype(np.float32) if ground else none,
        }

    def _on_frame(self, box: Box, values: Float32, empty: float) -> Float32:
        whole = np.full((self._frame.height, self._frame.width), empty, np.float32)
        inside = box.intersection(self._frame)
        if not inside.empty:
            whole[inside.slices_in(self._frame)] = values[inside.slices_in(box)]
        return whole


def _empty(*channels: int) -> Float32:
    return np.zeros((0, 0, *channels), np.float32)
