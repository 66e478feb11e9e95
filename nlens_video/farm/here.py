"""Chunks rendered in this process, in one run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from nlens_video.core.settings import Settings
from nlens_video.farm.chunk import write_chunks
from nlens_video.video.chunks.chunk_id import ChunkMark
from nlens_video.video.chunks.chunk_queue import ChunkFeed


def render_here(
    settings: Settings, marks: Sequence[ChunkMark], folder: Path,
    on_done: Callable[[ChunkMark], None],
) -> None:  # fmt: skip
    """Render chunks by one run, which starts and decodes once.

    Args:
        settings: the run.
        marks: what to render, in order.
        folder: where chunks lie.
        on_done: called with each that is done.

    Raises:
        NlensError: as `run.render`.
    """
    feed = ChunkFeed(marks, on_done)
    feed.end()
    write_chunks(settings, feed, folder)
