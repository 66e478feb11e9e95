"""What a worker does, and what it keeps from one task to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from nlens_video import interrupts
from nlens_video.chunk_mark import ChunkMark
from nlens_video.errors import UsageError
from nlens_video.farm.chunk import is_there, mark_of
from nlens_video.farm.job import Prepared, prepare
from nlens_video.farm.merge import Merged, merge_arriving
from nlens_video.farm.open_run import OpenRun
from nlens_video.run import render
from nlens_video.settings import OutputSettings, Settings, SourceSettings


class Workbench:
    """One at a time: the tasks of a farm; a shot's run stays open for the chunks that follow."""

    def __init__(self) -> None:
        self._open: OpenRun | None = None

    def prepare(self, settings: Settings, folder: Path, chunk_s: float) -> Prepared:
        """Find the lens and cut the plate into chunks, as `job.prepare`."""
        self._close()
        return prepare(settings, folder, chunk_s)

    def chunk(self, settings: Settings, mark: ChunkMark, folder: Path) -> None:
        """Render a chunk on a machine that may differ from the one that has planned it.

        Raises:
            UsageError: it differs.
            NlensError: as `chunk.write_chunk`.
        """
        if is_there(folder / mark.file_name, mark):
            return
        if self._open is None or not self._open.takes(settings, folder, mark):
            self._close()
            seen = mark_of(settings)
            if (seen.key, seen.plate) != (mark.key, mark.plate):
                raise UsageError(
                    "a worker sees other files, or has another version or renderer, than the one "
                    "that made the fit; give all of them the same"
                )
            self._open = OpenRun(settings, folder)
        self._open.render(mark)

    def whole(self, settings: Settings, frames: int) -> Merged:
        """Render a shot into its result, as a single run does.

        Args:
            settings: the run, with its lens.
            frames: of the plate [1].

        Raises:
            NlensError: as `run.render`.
        """
        self._close()
        outcome = render(replace(settings, track_focus="off"))
        return Merged(output=outcome.output, frames=frames, chunks=1, notes=outcome.notes)

    def merge(
        self, source: SourceSettings, marks: Sequence[ChunkMark], folder: Path,
        output: OutputSettings, look: Callable[[], None] = interrupts.look,
    ) -> Merged:  # fmt: skip
        """Join chunks as they come, as `merge.merge_arriving`."""
        self._close()
        return merge_arriving(source, marks, folder, output, look)

    def _close(self) -> None:
        if self._open is not None:
            self._open.close()
            self._open = None
