"""Merging of chunks: every frame is checked against the plate and encoded once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from nlens_video.core import signals
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.settings import OutputSettings, SourceSettings
from nlens_video.farm.chunk import plate_key
from nlens_video.farm.store import Store
from nlens_video.run.frame_range import FrameRange
from nlens_video.run.plate_source import opened
from nlens_video.run.render import OnProgress, note_on_what_is_left
from nlens_video.video.chunk_file import ChunkFile, fill
from nlens_video.video.chunk_queue import ChunkMark
from nlens_video.video.info import SourceFrame
from nlens_video.video.output.sink import open_sink
from nlens_video.video.pixels.picture import AvPicture

if TYPE_CHECKING:
    import av

_BESIDE_CHUNKS = (".json", ".npz")  # a fit, and what moves in front, in the same folder


class Merged(Struct, frozen=True, kw_only=True):
    """The result of a merge.

    Attributes:
        output: file name of the result.
        frames: written [1].
        chunks: merged [1].
        notes: for the user.
    """

    output: str
    frames: int
    chunks: int
    notes: tuple[str, ...]


def merge(
    source: SourceSettings, chunks: Sequence[Path], output: OutputSettings,
    on_progress: OnProgress = lambda done, total: None,
) -> Merged:  # fmt: skip
    """Merge chunks; audio, subtitles, tags and times are the plate's.

    The plate is decoded once more: its frames give count, times and side data, so that the encoder
    gets the same frames as in a run without chunks.

    Args:
        source: the plate of the chunks.
        chunks: files, in any order, or folders of them; the fit and what moves in front, which lie
            beside them, are left out.
        output: the result and its encoding.
        on_progress: called after each frame with (frames written, frames expected or None).

    Raises:
        UsageError: a chunk is missing, present twice, of another plate or of other settings.
        InputError: the plate or a chunk cannot be read.
        OutputError: the result cannot be written.
    """
    files: list[Path] = []
    for path in chunks:
        if path.suffix in _BESIDE_CHUNKS and not path.is_dir():
            continue
        inside = sorted(path.glob("[!.]*.nut")) if path.is_dir() else [path]
        if not inside:
            raise UsageError(f"{path}: contains no chunks (*.nut)")
        files += inside
    if not files:
        raise UsageError(f"{chunks[0]}: is no chunk (*.nut)")
    ordered = _sorted([ChunkFile(path) for path in files], plate_key(source), source.spec)
    return _merged(source, ordered, len(ordered), output, on_progress)


def merge_arriving(
    source: SourceSettings, marks: Sequence[ChunkMark], store: Store, output: OutputSettings,
    poll: Callable[[], None],
) -> Merged:  # fmt: skip
    """Merge chunks in order, each as soon as it is in the store.

    Args:
        source: the plate of the chunks.
        marks: of the chunks, in order and without a gap.
        store: in which they are or will be.
        output: the result and its encoding.
        poll: called after each frame and while waiting for a chunk; raises to cancel.

    Raises:
        NlensError: as `merge`.
    """
    arriving = _arriving(marks, store, poll)
    return _merged(source, arriving, len(marks), output, lambda done, total: poll())


def _arriving(
    marks: Sequence[ChunkMark], store: Store, poll: Callable[[], None]
) -> Iterator[ChunkFile]:
    for mark in marks:
        name = mark.file_name
        while not store.has(name):
            poll()
            time.sleep(store.poll_s)
        file = ChunkFile(store.fetch(name))
        if file.mark != mark:
            raise InputError(f"{name}: is not the chunk that its name says; remove it")
        yield file
        store.forget(name)


def _merged(
    source: SourceSettings, files: Iterable[ChunkFile], chunks: int, output: OutputSettings,
    on_progress: OnProgress,
) -> Merged:  # fmt: skip
    """Write the chunks' samples into the plate's frames and encode them."""
    written = 0
    with opened(source) as plate:
        sink = open_sink(
            output.spec, plate.info, codec=output.codec, crf=output.crf, pix_fmt=output.pix_fmt,
            keep_partial=output.keep_partial,
        )  # fmt: skip
        with note_on_what_is_left(sink, output.spec), sink:
            rendered = ((file, frame) for file in files for frame in file.frames())
            for item in FrameRange(plate, (0, None)).items():
                signals.check()
                if not isinstance(item, SourceFrame):
                    sink.write_packet(item)
                    continue
                following = next(rendered, None)
                if following is None:
                    raise UsageError(f"frames {item.index} and on are missing; render that chunk")
                _replace_samples(item, *following)
                sink.write(item)
                written += 1
                on_progress(written, plate.info.frame_count)
            following = next(rendered, None)
            if following is not None:
                raise InputError(
                    f"{following[0].path}: goes on after the plate's last frame {written - 1}; "
                    "render it again"
                )
            sink.commit()
            notes = (*plate.info.notes, *sink.notes)
    return Merged(output=output.spec, frames=written, chunks=chunks, notes=notes)


def _replace_samples(frame: SourceFrame, file: ChunkFile, rendered: av.VideoFrame) -> None:
    """Replace the samples of the plate's frame by the rendered ones.

    Raises:
        UsageError: the plate has no chunks.
        InputError: the rendered frame has another time, or is damaged.
    """
    moment = frame.pts * frame.time_base
    found = (rendered.pts or 0) * Fraction(rendered.time_base or 0)
    if found != moment:
        raise InputError(
            f"{file.path}: frame {frame.index} is at {float(found):.6f} s, the plate's at "
            f"{float(moment):.6f} s; render this chunk again"
        )
    if not isinstance(frame.picture, AvPicture):
        raise UsageError("a plate in OpenEXR has no chunks; give a video or other pictures")
    fill(frame.picture, rendered)


def _sorted(files: list[ChunkFile], plate: str, name: str) -> list[ChunkFile]:
    """The chunks, at least one, in order of their frames; `plate` is the key, `name` the file.

    Raises:
        UsageError: they are not of one result, overlap, or leave a gap.
    """
    for file in files:
        if file.mark.plate != plate:
            raise UsageError(
                f"{file.path}: was made from another plate than {name}; give the chunks of that one"
            )
        if file.mark.key != files[0].mark.key:
            raise UsageError(
                f"{file.path} and {files[0].path} were made with different settings, objects or "
                f"lenses; give the chunks of one run, such as {files[0].mark.key}-*.nut"
            )
    ordered = sorted(files, key=lambda file: file.mark.first)
    if ordered[0].mark.first > 0:
        raise UsageError(f"frames 0 to {ordered[0].mark.first - 1} are missing; render that chunk")
    for file, later in pairwise(ordered):
        if file.mark.end is None or file.mark.end > later.mark.first:
            raise UsageError(
                f"{file.path} and {later.path} overlap: both hold frame {later.mark.first}; "
                "leave one of them out"
            )
        end = file.mark.first + file.count
        if end < later.mark.first:
            raise UsageError(
                f"frames {end} to {later.mark.first - 1} are missing, between {file.path} and "
                f"{later.path}; render that chunk"
            )
    return ordered
