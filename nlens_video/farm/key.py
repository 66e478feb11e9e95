"""Content-addressed names of chunks: a hash of everything that their pictures depend on.

Paths and times of files are not part of it, so that copies on other machines have the same key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

from nlens_video.core.errors import InputError
from nlens_video.core.settings import Settings, SourceSettings
from nlens_video.core.version import VERSION
from nlens_video.graph.pipeline_file import pipelines_folder
from nlens_video.networks.model_store import MANIFEST, models_folder
from nlens_video.render.select import renderer_name
from nlens_video.video.numbered import ImageSequence

_LENGTH = 16  # hexadecimal digits of a key: 64 bits
_WHOLE = 16 << 20  # files up to so many bytes are hashed whole
_SAMPLE, _SAMPLES = 1 << 20, 8  # of larger ones so many parts of so many bytes, ends included


def job_key(settings: Settings) -> str:
    """Key of a result's pictures: plate, object, settings, lens, weights and version.

    Args:
        settings: the run; output, range and sidecar outputs are not part of the key.

    Raises:
        InputError: a file that it names cannot be read.
    """
    bare = replace(
        settings,
        source=replace(settings.source, frames=(0, None)),
        output=None, budget_ms=1.0, save_fit=None, report=None, aov=None, timings=None,
    )  # fmt: skip
    shipped = pipelines_folder() / f"{settings.preset}.toml"
    pipeline = shipped if shipped.is_file() else Path(settings.preset)
    parts = {
        "version": VERSION,
        "renderer": renderer_name(),
        "models": _of_file(models_folder() / MANIFEST),
        "pipeline": _of_file(pipeline),
        "plate": plate_key(settings.source),
        "layers": _of_spec(settings.scene.layers),
        "holdout": _of_spec(settings.scene.real.holdout),
        "settings": _plain(bare),
    }
    return _digest(json.dumps(parts, sort_keys=True).encode("utf-8", "surrogateescape"))


def plate_key(source: SourceSettings) -> str:
    """Key of a plate: its bytes and its input options.

    Raises:
        InputError: it cannot be read, or is no file.
    """
    return _digest(f"{_of_spec(source.spec)} {source.hints}".encode("utf-8", "surrogateescape"))


_SPECS = (
    "spec",
    "layers",
    "holdout",
    "preset",
)  # fields that name files, hashed apart


def _plain(value: object) -> object:
    """Settings as plain data, with hashes of files in place of paths."""
    if isinstance(value, Path):
        return _of_file(value)
    if is_dataclass(value):
        return {
            field.name: _plain(getattr(value, field.name))
            for field in fields(value)
            if field.name not in _SPECS
        }
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value if value is None or isinstance(value, str | bool | int) else repr(value)


def _of_spec(spec: str | None) -> str:
    """Hash of a file or of a sequence of files."""
    if spec is None:
        return ""
    if Path(spec).is_file() or not ImageSequence.matches(spec):
        return _of_file(Path(spec))
    sequence = ImageSequence(spec)
    files = (f"{number} {_of_file(sequence.path(number))}" for number in sequence.span())
    return _digest("\n".join(files).encode("utf-8", "surrogateescape"))


def _of_file(path: Path) -> str:
    """Hash of a file's bytes; of a large file, of its size and some parts."""
    try:
        size = path.stat().st_size
        digest = hashlib.sha256(f"{size}\n".encode("utf-8", "surrogateescape"))
        with path.open("rb") as file:
            for start, length in _parts(size):
                file.seek(start)
                digest.update(file.read(length))
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); chunks are made of files only"
        ) from error
    return digest.hexdigest()


def _parts(size: int) -> Iterator[tuple[int, int]]:
    if size <= _WHOLE:
        yield 0, size
        return
    for number in range(_SAMPLES):
        yield (size - _SAMPLE) * number // (_SAMPLES - 1), _SAMPLE


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_LENGTH]
