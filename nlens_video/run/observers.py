"""Sidecar outputs of a run: the saved fit, timing rows, EXR layers and the report."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Self

import numpy as np
from msgspec.structs import asdict

from nlens_video.core.errors import OutputError
from nlens_video.core.layers import BlurredLayer, Box, Float32, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import OutputSettings, Settings
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.executor import FrameState, Observer
from nlens_video.graph.pipeline_file import FORMER_NAMES
from nlens_video.graph.session import Session
from nlens_video.stages.r_lens_track import FitTrack
from nlens_video.video.atomic_files import check_folder, make_folder, remove_stale, replacing
from nlens_video.video.exr import write_layers
from nlens_video.video.info import SourceInfo


def observers(
    settings: Settings, info: SourceInfo, session: Session, output: OutputSettings | None
) -> list[Observer]:
    """The observers that the settings ask for.

    Args:
        settings: the run.
        info: its source.
        session: its graph.
        output: the result; None where that is the lens fit.

    Raises:
        OutputError: a folder or file cannot be made.
    """
    found: list[Observer] = []
    if settings.save_fit is not None and output is not None:
        found.append(SavedFit(settings.save_fit, session, settings.source.frames[0]))
    if settings.timings is not None:
        found.append(TimingRows(settings.timings, settings, session))
    if settings.aov is not None:
        found.append(AovLayers(settings.aov, info, session))
    if settings.report is not None:
        from nlens_video.report.collect import Report

        written = output.spec if output is not None else str(settings.save_fit)
        found.append(Report(settings.report, info, session, written))
    return found


class SavedFit(Observer):
    """`--save-fit`: the lens fit, where there is one, or the track of a lens that was followed.

    Args:
        path: of the file.
        session: its graph.
        first: frame that the run begins with [1].
    """

    def __init__(self, path: Path, session: Session, first: int) -> None:
        super().__init__()
        check_folder(path)
        remove_stale(path)
        self.what = f"--save-fit {path}"
        self._path, self._first = path, first
        self._executor = session.executor

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """Write it."""
        found = self._executor.track or self._executor.fit
        if found is not None:
            save_fit(found, self._path, self._first)


def save_fit(fit: LensFit | FitTrack, path: Path, first: int = 0) -> None:
    """Write a lens fit as JSON.

    Args:
        fit: the lens, or the track of one that changes.
        path: of the file.
        first: frame whose lens readers without tracks get [1].

    Raises:
        OutputError: it cannot be written.
    """
    with replacing(path) as partial:
        partial.write_text(fit.to_json(first) if isinstance(fit, FitTrack) else fit.to_json())


class TimingRows(Observer):
    """`--timings`: one row per frame, written at once, so that memory does not grow.

    Under `aliases` stand the names before 1.0 of the nodes that ran: today's to the former one.
    """

    def __init__(self, path: Path, settings: Settings, session: Session) -> None:
        super().__init__()
        check_folder(path)
        remove_stale(path)
        self.what = f"--timings {path}"
        self._path = path
        self._stream: IO[str] | None = None
        self._head = {
            "budget_ms": settings.budget_ms,
            "preset": session.graph.pipeline,
            "device": session.device.name,
        }
        self._rows = 0
        self._ran: set[str] = set()

    def __enter__(self) -> Self:
        partial = self._stack.enter_context(replacing(self._path))
        self._stream = self._stack.enter_context(partial.open("w"))
        head = json.dumps(self._head, indent=1)
        self._stream.write(head.rstrip("}\n") + ',\n "frames": [')
        return self

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


class AovLayers(Observer):
    """`--aov`: the layers of each frame as multi-channel OpenEXR."""

    def __init__(self, folder: Path, info: SourceInfo, session: Session) -> None:
        super().__init__()
        make_folder(folder)
        remove_stale(folder / "any.exr", whole_folder=True)
        self.what = f"--aov {folder}"
        self._folder = folder
        self._frame = Box(0, 0, info.width, info.height)
        self._executor = session.executor
        self._executor.shot.keeps_maps = True

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Write one file with the same channels on every frame, empty where there is no layer.

        They are named layer.pass.channel, the only names of layers that Blender reads; those
        without a layer are what other programs show at once.
        """
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
            channels[f"object.Combined.{name}"] = self._on_frame(
                layer.box, layer.rgba[..., at], 0.0
            )
            channels[name] = self._on_frame(blurred.box, blurred.rgba[..., at], 0.0)
        channels["object.Depth.Z"] = self._on_frame(layer.box, layer.depth, np.inf)
        channels["object.coc_px.V"] = self._on_frame(layer.box, coc, 0.0)
        write_layers(self._folder / f"{state.frame.number:06d}.exr", channels)

    def _plate(self) -> dict[str, Float32]:
        """Plate CoC and footprint of the fit; zero until it is made, and where it was given."""
        size = (self._frame.height, self._frame.width)
        coc, ground = self._executor.shot.plate_coc, self._executor.shot.ground
        none = np.zeros(size, np.float32)
        return {
            "plate.coc_px.V": coc.coc_px if coc else none,
            "plate.sigma_px.V": coc.sigma_px if coc else none,
            "projection.mask.V": ground.mask.astype(np.float32) if ground else none,
        }

    def _on_frame(self, box: Box, values: Float32, empty: float) -> Float32:
        whole = np.full((self._frame.height, self._frame.width), empty, np.float32)
        inside = box.intersection(self._frame)
        if not inside.empty:
            whole[inside.slices_in(self._frame)] = values[inside.slices_in(box)]
        return whole


def _empty(*channels: int) -> Float32:
    return np.zeros((0, 0, *channels), np.float32)


class SidecarOutputs(Observer):
    """Several observers as one; an observer that fails to write is dropped.

    Args:
        observers: that write files.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        super().__init__()
        self._observers = tuple(observers)  # replaced, never changed: two threads read it
        self._missing: list[str] = []

    @property
    def missing(self) -> tuple[str, ...]:
        """One line for each output that could not be written so far, with the reason."""
        return tuple(self._missing)

    def __enter__(self) -> Self:
        with ExitStack() as entered:
            for one in self._observers:
                entered.enter_context(one)
            self._stack = entered.pop_all()
        return self

    def on_frame_start(self, state: FrameState) -> None:
        """A frame was decoded; called on the decoding thread."""
        for one in self._observers:
            one.on_frame_start(state)

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame was written."""
        for one in self._observers:
            with self._dropped_on_error(one):
                one.frame(state, timing)

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """The result is complete."""
        for one in self._observers:
            with self._dropped_on_error(one):
                one.finish(summary, notes)

    @contextmanager
    def _dropped_on_error(self, one: Observer) -> Iterator[None]:
        """Drop an observer that cannot write."""
        try:
            yield
        except (OutputError, OSError) as error:
            with suppress(OutputError, OSError):  # the same full disk again
                one.__exit__(type(error), error, error.__traceback__)
            self._observers = tuple(other for other in self._observers if other is not one)
            reason = error.strerror if isinstance(error, OSError) else str(error)
            self._missing.append(f"{one.what}: {reason or error}")


def check_sidecars(result: str, missing: Sequence[str]) -> None:
    """Fail a command whose result is complete but whose sidecar outputs are not.

    Args:
        result: name of the result.
        missing: as of `SidecarOutputs`.

    Raises:
        OutputError: a sidecar output is missing.
    """
    if missing:
        raise OutputError(
            f"{result} is complete, but not what was asked for beside it: " + "; ".join(missing)
        )


@contextmanager
def note_on_complete_result(
    result: str, complete: Callable[[], bool] = lambda: True
) -> Iterator[None]:
    """Add to an error that the result is complete, where it is."""
    try:
        yield
    except BaseException as error:
        if complete():
            error.add_note(f"{result} is complete")
        raise
