"""A shot rendered in chunks: one lens fit, chunks, one merge."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core import signals
from nlens_video.core.errors import OutOfViewError, UsageError
from nlens_video.core.settings import OutputSettings, Settings, SourceSettings
from nlens_video.effects.planner import EffectRequest
from nlens_video.farm.chunk import (
    check_repeatable,
    look_once,
    mark_of,
    with_stored_look,
    write_chunks,
)
from nlens_video.farm.merge import Merged, merge
from nlens_video.farm.store import Folder, Store
from nlens_video.run.find_fit import find_fit
from nlens_video.run.plate_source import frame_s, opened
from nlens_video.run.preflight import preflight
from nlens_video.run.render import OnProgress
from nlens_video.video.chunk_queue import ChunkFeed, ChunkMark
from nlens_video.video.output.stream_output import is_stream

PIECE_S = 2.0
"""Length of one file of frames, which is what a killed run or a lost worker loses [s]."""


class Prepared(Struct, frozen=True, kw_only=True):
    """A shot that is ready for rendering in chunks.

    Attributes:
        fit: name of the lens fit in the store, None where it was given or is not needed.
        marks: the chunks, in order; together the whole plate.
        frames: of the plate [1].
        frame_s: frame interval [s].
    """

    fit: str | None
    marks: tuple[ChunkMark, ...]
    frames: int
    frame_s: float


def run_job(
    settings: Settings, folder: Path, chunk_s: float, on_progress: OnProgress, *,
    clear: bool = False,
) -> Merged:  # fmt: skip
    """Fit the lens, render the missing chunks by one run in this process, merge.

    Args:
        settings: the run.
        folder: of chunks and fit; created if missing.
        chunk_s: length of a chunk, > 0 [s].
        on_progress: called with (frames rendered, frames in all).
        clear: whether the folder is removed once the result is complete.

    Raises:
        UsageError: an option is given that needs a single run, such as --range or --report.
        FolderInUse: another run is using the folder.
        OutputError: the folder cannot be created.
        NlensError: as `run.render` and `merge`.
    """
    output = check_chunkable(settings)
    with opened(settings.source) as plate:
        preflight(settings, plate.info)
    store = Folder(folder)
    with store.held():
        prepared = prepare(settings, store, chunk_s)
        existing = store.existing(mark.file_name for mark in prepared.marks)
        missing = [mark for mark in prepared.marks if mark.file_name not in existing]
        done = prepared.frames - sum(length_of(mark, prepared.frames) for mark in missing)
        on_progress(done, prepared.frames)

        def finished(mark: ChunkMark) -> None:
            nonlocal done
            done += length_of(mark, prepared.frames)
            on_progress(done, prepared.frames)

        if missing:
            feed = ChunkFeed(missing, finished)
            feed.end()
            known = with_stored_fit(settings, prepared.fit, store)
            known = with_stored_look(known, store, missing[0].key)
            write_chunks(known, feed, folder)
        files = [folder / mark.file_name for mark in prepared.marks]
        merged = merge(settings.source, files, output)
        if clear:
            store.clear()  # while no other run can have begun in it
    return merged


def prepare(settings: Settings, store: Store, chunk_s: float) -> Prepared:
    """Fit the lens, look for what moves in front of the object, and divide the plate into chunks.

    Args:
        settings: the run.
        store: of the fit.
        chunk_s: length of a chunk, > 0 [s].

    Raises:
        NlensError: as `run.find_fit`.
    """
    with opened(settings.source) as plate:
        seconds = frame_s(plate.info) or 1 / 25
    fit = _found_fit(settings, store)
    frames = _count_frames(settings.source)
    known = with_stored_fit(settings, fit, store)
    whole = mark_of(known)
    look_once(known, store, whole.key)
    parts = ranges(frames, max(1, round(chunk_s / seconds)))
    marks = tuple(replace(whole, first=first, end=end) for first, end in parts)
    return Prepared(fit=fit, marks=marks, frames=frames, frame_s=seconds)


def ranges(frames: int, length: int) -> Iterator[tuple[int, int]]:
    """Ranges of `length` frames that cover `frames` frames; the last may be shorter."""
    for first in range(0, frames, length):
        yield first, min(first + length, frames)


def with_stored_fit(settings: Settings, fit: str | None, store: Store) -> Settings:
    """The run with a lens fit of the store; unchanged where `fit` is None."""
    return settings if fit is None else replace(settings, fit=store.fetch(fit))


def _found_fit(settings: Settings, store: Store) -> str | None:
    """Name of the lens fit, made once; None where one is given or no frame needs it.

    Raises:
        NlensError: as `run.find_fit`.
    """
    if settings.fit is not None or "defocus" not in EffectRequest.parse(settings.effects).possible:
        return None
    name = f"fit-{mark_of(settings).key}.json"
    if not store.has(name):
        fit_run = replace(settings, effects="defocus", output=None, save_fit=store.local / name)
        try:
            find_fit(fit_run, search_frames=math.inf)
        except OutOfViewError:
            return None  # no frame shows the object
        store.put(name)
    return name


def check_chunkable(settings: Settings) -> OutputSettings:
    """Check that a run can be rendered in chunks; returns its output.

    Raises:
        UsageError: an option or the output does not allow it.
    """
    first, end = settings.source.frames
    ranged = "--range or --frame" if end == first + 1 else "--range"
    if (first, end) != (0, None):
        raise UsageError(f"{ranged}: chunks are made of all frames and only them; leave it out")
    for option, place in (
        ("--report", settings.report), ("--aov", settings.aov), ("--timings", settings.timings),
    ):  # fmt: skip
        if place is not None:
            raise UsageError(
                f"{option}: is written by runs that render all frames at once, not in chunks; "
                "leave it out"
            )
    check_repeatable(settings)
    if settings.save_fit is not None:
        raise UsageError("--save-fit: belongs to single runs; keep the lens with nlens-video fit")
    if settings.output is None:
        raise UsageError("no output was named")
    if is_stream(settings.output.spec):
        raise UsageError(f"{settings.output.spec}: chunks are merged into a file; name one")
    return settings.output


def _count_frames(source: SourceSettings) -> int:
    """Number of frames that the decoder gives."""
    count = 0
    with opened(source) as plate:
        for frame in plate:
            signals.check()
            count = frame.index + 1
    return count


def length_of(mark: ChunkMark, frames: int) -> int:
    """Number of frames of a chunk; `frames` is that of the plate [1]."""
    return (frames if mark.end is None else mark.end) - mark.first


def absolute(settings: Settings) -> Settings:
    """The settings with absolute paths."""
    scene, light, real = settings.scene, settings.scene.light, settings.scene.real
    aperture = settings.aperture
    own_pipeline = settings.preset.endswith(".toml")
    return replace(
        settings,
        source=replace(settings.source, spec=_absolute_spec(settings.source.spec)),
        scene=replace(
            scene,
            glb=scene.glb.absolute(),
            others=tuple(replace(one, glb=one.glb.absolute()) for one in scene.others),
            camera_from=_path(scene.camera_from),
            layers=None if scene.layers is None else _absolute_spec(scene.layers),
            light=replace(light, env=_path(light.env)),
            real=replace(
                real, holdout=None if real.holdout is None else _absolute_spec(real.holdout)
            ),
        ),
        preset=_absolute_spec(settings.preset) if own_pipeline else settings.preset,
        aperture=None if aperture is None else replace(aperture, image=_path(aperture.image)),
        fit=_path(settings.fit),
    )


def _path(path: Path | None) -> Path | None:
    return None if path is None else path.absolute()


def _absolute_spec(spec: str) -> str:
    return str(Path(spec).absolute())
