"""Rendering of chunks: frame ranges of a shot, each a lossless file named by its content."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.core.settings import OutputSettings, Settings
from nlens_video.farm.folder import create
from nlens_video.farm.key import job_key, plate_key
from nlens_video.farm.store import Folder
from nlens_video.run.render import OnProgress, render
from nlens_video.run.result import RunResult
from nlens_video.video.chunks.chunk_id import ChunkMark
from nlens_video.video.chunks.chunk_queue import ChunkFeed
from nlens_video.video.input.open import can_be_read_again


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """A chunk on the disk.

    Attributes:
        path: its file.
        result: of the run that rendered it; None where it existed already.
    """

    path: Path
    result: RunResult | None


def render_chunk(
    settings: Settings, folder: Path, on_progress: OnProgress = lambda done, total: None
) -> Chunk:
    """Render the range of a run into a folder of chunks.

    Args:
        settings: the run, with the lens fit that all chunks share; its output is ignored.
        folder: of the chunks; created if missing.
        on_progress: as of `run.render`.

    Raises:
        UsageError: no lens was given, or the plate is a stream.
        NlensError: as `run.render`.
    """
    if settings.fit is None:
        raise UsageError(
            "--as-chunk: chunks share one lens; find it with nlens-video fit and give --fit"
        )
    output = settings.output
    if output is not None and (output.codec, output.crf, output.pix_fmt) != (None, None, None):
        raise UsageError(
            "--as-chunk: chunks are lossless and as the plate; give the encoding to merge"
        )
    return write_chunk(settings, mark_of(settings), folder, on_progress)


def mark_of(settings: Settings) -> ChunkMark:
    """The chunk that the range of a run makes.

    Raises:
        UsageError: the plate is a stream.
        InputError: a file cannot be read.
    """
    if settings.hold_budget:
        raise UsageError("--hold-budget: what it writes depends on the machine; leave it out")
    if not can_be_read_again(settings.source.spec):
        raise UsageError(
            f"{settings.source.spec}: chunks are made of a file or a sequence, which can be read "
            "again; record the stream first"
        )
    first, end = settings.source.frames
    return ChunkMark(key=job_key(settings), plate=plate_key(settings.source), first=first, end=end)


def write_chunk(
    settings: Settings, mark: ChunkMark, folder: Path,
    on_progress: OnProgress = lambda done, total: None,
) -> Chunk:  # fmt: skip
    """Render one chunk, unless its file exists.

    Args:
        settings: the run; its output is ignored.
        mark: the chunk.
        folder: of the chunks; created if missing.
        on_progress: as of `run.render`.

    Raises:
        NlensError: as `run.render`.
    """
    path = folder / mark.file_name
    if Folder(folder).has(mark.file_name):
        return Chunk(path=path, result=None)
    feed = ChunkFeed((mark,))
    feed.end()
    result = write_chunks(settings, feed, folder, on_progress)
    return Chunk(path=path, result=replace(result, output=str(path)))


def write_chunks(
    settings: Settings, feed: ChunkFeed, folder: Path,
    on_progress: OnProgress = lambda done, total: None,
) -> RunResult:  # fmt: skip
    """Render queued chunks by one run, which starts and decodes the plate once.

    Args:
        settings: the run; its output is ignored.
        feed: the chunks.
        folder: of the chunks; created if missing.
        on_progress: as of `run.render`.

    Raises:
        NlensError: as `run.render`; chunks that are complete stay.
    """
    create(folder)
    run = replace(settings, output=OutputSettings(spec=str(folder)), track_focus="off")
    return render(run, on_progress, feed)


def render_locally(
    settings: Settings, marks: Sequence[ChunkMark], folder: Path,
    on_done: Callable[[ChunkMark], None],
) -> None:  # fmt: skip
    """Render chunks by one run in this process.

    Args:
        settings: the run.
        marks: the chunks, in order.
        folder: of the chunks.
        on_done: called with each finished chunk.

    Raises:
        NlensError: as `run.render`.
    """
    feed = ChunkFeed(marks, on_done)
    feed.end()
    write_chunks(settings, feed, folder)
