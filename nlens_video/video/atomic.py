"""Files that appear only when they are complete: temporary name in the same folder, then rename."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nlens_video.errors import OutputError


def partial_name(path: Path) -> Path:
    """Name beside `path` under which it is written; keeps the extension, so players open it."""
    return path.with_name(f".{path.stem}.partial-{os.getpid()}{path.suffix}")


def check_folder(path: Path) -> None:
    """See that a file can be made there.

    Raises:
        OutputError: the folder is missing, is read-only, or the name is that of a folder.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist; make it first")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{path}: the folder {path.parent} cannot be written to")


def publish(partial: Path, path: Path) -> None:
    """Bring a finished file to the disk and give it its name.

    Raises:
        OutputError: the disk is full or the folder went away.
    """
    try:
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write to the yielded name; `path` appears at the end, or nothing does.

    Raises:
        OutputError: it cannot be written; an OSError of the body that names no other file, such
            as that of a full disk, becomes this.
    """
    check_folder(path)
    partial = partial_name(path)
    try:
        yield partial
        publish(partial, path)
    except OSError as error:
        if error.filename not in (None, str(partial)):
            raise  # something else that the body does
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
