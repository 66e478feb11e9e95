"""Chunks: frame ranges of a shot as lossless files, named by a hash of what their pictures show.

The hash leaves out paths and times of files, so that copies on other machines have the same name.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from msgspec import Struct
from msgspec.structs import asdict, replace

from nlens_video.cameras.files import beside_camera
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.settings import OutputSettings, Settings, SourceSettings
from nlens_video.core.version import VERSION
from nlens_video.farm.store import NAME_A_FOLDER, Folder, Store
from nlens_video.graph.pipeline_file import pipelines_folder
from nlens_video.networks.model_store import MANIFEST, models_folder
from nlens_video.options.files import beside_scene, listed
from nlens_video.render.select import renderer_name
from nlens_video.run.foreground_pass import foreground_pass
from nlens_video.run.render import OnProgress, RunResult, render
from nlens_video.video.atomic_files import make_folder
from nlens_video.video.chunk_queue import ChunkFeed, ChunkMark
from nlens_video.video.input.open import can_be_read_again, check_file
from nlens_video.video.named_files import ImageSequence

_LENGTH = 16  # hexadecimal digits of a key: 64 bits
_WHOLE = 16 << 20  # files up to so many bytes are hashed whole
_SAMPLE, _SAMPLES = 1 << 20, 8  # of larger ones so many parts of so many bytes, ends included
_SPECS = ("spec", "layers", "holdout", "preset")  # fields that name files, hashed apart


class Chunk(Struct, frozen=True, kw_only=True):
    """A chunk on the disk.

    Attributes:
        path: its file.
        result: of the run that rendered it; None where it existed already.
    """

    path: Path
    result: RunResult | None


def render_chunk(settings: Settings, folder: Path, on_progress: OnProgress) -> Chunk:
    """Render the range of a run into a folder of chunks, unless its file exists.

    Args:
        settings: the run, with the lens fit that all chunks share; its output is ignored.
        folder: of the chunks; created if missing.
        on_progress: as of `run.render`.

    Raises:
        UsageError: as of `check_chunk`, or the plate is a stream.
        NlensError: as `run.render`.
    """
    check_chunk(settings)
    mark = mark_of(settings)
    path = folder / mark.file_name
    store = Folder(folder)
    if store.has(mark.file_name):
        return Chunk(path=path, result=None)
    feed = ChunkFeed((mark,))
    feed.end()
    make_folder(folder, NAME_A_FOLDER)
    look_once(settings, store, mark.key)
    known = with_stored_look(settings, store, mark.key)
    result = write_chunks(known, feed, folder, on_progress)
    return Chunk(path=path, result=replace(result, output=str(path)))


def check_chunk(settings: Settings) -> None:
    """Check that a run can be rendered as a chunk by itself, before anything is made.

    Raises:
        UsageError: no lens is given, or an encoding, or the pictures depend on the machine.
    """
    check_repeatable(settings)
    if settings.fit is None:
        raise UsageError(
            "--chunk-out: chunks share one lens; find it with nlens-video fit and give --fit"
        )
    output = settings.output
    if output is not None and (output.codec, output.crf, output.pix_fmt) != (None, None, None):
        raise UsageError(
            "--chunk-out: chunks are lossless and as the plate; give the encoding to merge"
        )


def check_plate(spec: str) -> None:
    """Check that chunks can be made of a plate, before anything is made.

    Raises:
        UsageError: it is a stream.
        InputError: there is no such file, or it is empty.
    """
    if spec != "-" and "://" not in spec and not ImageSequence.matches(spec):
        check_file(spec)
    if not can_be_read_again(spec):
        raise UsageError(
            f"{spec}: chunks are made of a file or a sequence, which can be read again; record the "
            "stream first"
        )


def check_repeatable(settings: Settings) -> None:
    """Check that a run gives the same pictures on any machine.

    Raises:
        UsageError: they depend on its speed.
    """
    if settings.hold_budget:
        raise UsageError("--hold-budget: what it writes depends on the machine; leave it out")


def mark_of(settings: Settings) -> ChunkMark:
    """The chunk that the range of a run makes.

    Raises:
        UsageError: the plate is a stream, or the pictures depend on the machine.
        InputError: a file cannot be read.
    """
    check_repeatable(settings)
    check_plate(settings.source.spec)
    first, end = settings.source.frames
    return ChunkMark(key=job_key(settings), plate=plate_key(settings.source), first=first, end=end)


def look_once(settings: Settings, store: Store, key: str) -> None:
    """Look for what moves in front of the object, unless the store has what was found.

    Args:
        settings: the run.
        store: of the chunks.
        key: of the chunks.

    Raises:
        NlensError: as `run.render` and `Store.put`.
    """
    name = _look_name(key)
    whole = replace(settings, source=replace(settings.source, frames=(0, None)))
    if not store.has(name) and foreground_pass(whole, store.local / name):
        store.put(name)


def with_stored_look(settings: Settings, store: Store, key: str) -> Settings:
    """The run with what was found in front of the object; unchanged where nobody looked."""
    name = _look_name(key)
    if not store.has(name):
        return settings
    scene = settings.scene
    real = replace(scene.real, found=store.fetch(name))
    return replace(settings, scene=replace(scene, real=real))


def _look_name(key: str) -> str:
    return f"front-{key}.npz"


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
    make_folder(folder, NAME_A_FOLDER)
    run = replace(settings, output=OutputSettings(spec=str(folder)), track_focus="off")
    return render(run, on_progress, feed)


def job_key(settings: Settings) -> str:
    """Key of a result's pictures: plate, object, settings, lens, weights and version.

    Args:
        settings: the run; output, range, sidecar outputs and what is known of its frames
            beforehand are not part of the key.

    Raises:
        InputError: a file that it names cannot be read.
    """
    scene = settings.scene
    bare = replace(
        settings,
        scene=replace(scene, real=replace(scene.real, found=None)),
        source=replace(settings.source, frames=(0, None)),
        output=None, budget_ms=1.0, save_fit=None, report=None, aov=None, timings=None,
    )  # fmt: skip
    shipped = pipelines_folder() / f"{settings.preset}.toml"
    pipeline = shipped if shipped.is_file() else Path(settings.preset)
    parts = {
        "version": VERSION,
        "renderer": renderer_name(),
        "models": _hash_of_file(models_folder() / MANIFEST),
        "pipeline": _hash_of_file(pipeline),
        "plate": plate_key(settings.source),
        "layers": _hash_of_spec(settings.scene.layers),
        "holdout": _hash_of_spec(settings.scene.real.holdout),
        "settings": _plain(bare),
    }
    return _digest(json.dumps(parts, sort_keys=True))


def plate_key(source: SourceSettings) -> str:
    """Key of a plate: its bytes and its input options.

    Raises:
        InputError: it cannot be read, or is no file.
    """
    return _digest(f"{_hash_of_spec(source.spec)} {source.hints}")


def _plain(value: object) -> object:
    """Settings as plain data, with hashes of files in place of paths."""
    if isinstance(value, Path):
        return _hash_with_beside(value)
    if isinstance(value, Struct):
        named = asdict(value).items()
        return {name: _plain(one) for name, one in named if name not in _SPECS}
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value if value is None or isinstance(value, str | bool | int) else repr(value)


def _hash_of_spec(spec: str | None) -> str:
    """Hash of a file, of a playlist and the files that it names, or of a sequence of files."""
    if spec is None:
        return ""
    sequence = ImageSequence.of_input(spec)
    if sequence is None:
        own, *others = map(_hash_of_file, _with_listed(Path(spec)))
        return _digest("\n".join((own, *others))) if others else own
    files = (f"{number} {_hash_of_file(sequence.path(number))}" for number in sequence.span())
    return _digest("\n".join(files))


def _with_listed(path: Path) -> list[Path]:
    """A file and, where it is a playlist, the files that it names, those of playlists included."""
    found, known = [path], {path}
    for one in found:  # it grows meanwhile
        new = {*listed(one)} - known
        found += sorted(new)
        known |= new
    return found


def _hash_with_beside(path: Path) -> str:
    """Hash of a scene's or a camera's file or folder and of the files that are read with it.

    One of these that is not there counts as empty: whether it is needed is told where it is read.
    """
    own = "" if path.is_dir() else _hash_of_file(path)
    beside = (*beside_camera(path), *beside_scene(path))
    hashes = (_hash_of_file(file) if file.is_file() else "" for file in beside)
    return _digest("\n".join((own, *hashes)))


def _hash_of_file(path: Path) -> str:
    """Hash of a file's bytes; of a large file, of its size and some parts."""
    try:
        size = path.stat().st_size
        digest = hashlib.sha256(b"%d\n" % size)
        with path.open("rb") as file:
            if size <= _WHOLE:
                digest.update(file.read())
            else:
                for number in range(_SAMPLES):
                    file.seek((size - _SAMPLE) * number // (_SAMPLES - 1))
                    digest.update(file.read(_SAMPLE))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); chunks are made of files only"
        ) from error
    return digest.hexdigest()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:_LENGTH]
