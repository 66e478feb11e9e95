"""Files that appear only when they are complete: temporary name in the same folder, then rename.

A temporary's name tells whose it is, so that the next run finds what a killed one has left.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nlens_video.errors import OutputError


def partial_name(path: Path) -> Path:
    """Name beside `path` under which it is written; keeps the extension, so players open it."""
    return path.with_name(f".{path.stem}.partial-{_host()}-{os.getpid()}{path.suffix}")


def kept_name(path: Path) -> Path:
    """Name of the part of `path` that an aborted run leaves, where that was asked for."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def left_over(path: Path, *, whole_folder: bool = False) -> list[Path]:
    """Temporaries of `path` whose runs are gone: those of processes of this machine that ended.

    Args:
        path: the result; of a sequence its pattern.
        whole_folder: whether temporaries of other results with its extension count too.
    """
    stem = ".+" if whole_folder else re.escape(path.stem)
    shape = re.compile(rf"\.{stem}\.partial-{_host()}-(\d+){re.escape(path.suffix)}")
    try:
        names = [(one, shape.fullmatch(one.name)) for one in path.parent.iterdir()]
    except OSError:
        return []  # whoever writes there will say so
    return sorted(one for one, match in names if match and not _runs(int(match[1])))


def sweep(path: Path, *, whole_folder: bool = False) -> tuple[str, ...]:
    """Remove what `left_over` finds; a note on each."""
    notes = []
    for found in left_over(path, whole_folder=whole_folder):
        with contextlib.suppress(OSError):
            shutil.rmtree(found) if found.is_dir() else found.unlink()
            notes.append(f"removed {found.name}, left by a run that was killed")
    return tuple(notes)


def _host() -> str:
    """This machine, in letters and digits: others that share the folder have other names."""
    return re.sub(r"[^0-9A-Za-z]", "", socket.gethostname())[:24] or "host"


def _runs(process: int) -> bool:
    """Whether there is such a process; on Windows, where asking would disturb it, there may be."""
    if sys.platform == "win32":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True  # somebody else's
    return True


def check_folder(path: Path) -> None:
    """See that a file can be made there.

    Raises:
        OutputError: the folder is missing, is read-only, or the name is that of a folder, a device
            or a pipe.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not path.is_file():  # its place would be taken by the finished file
        raise OutputError(f"{path}: is a device or a pipe; give the name of a file")
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
