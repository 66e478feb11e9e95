"""Files that appear only when they are complete: temporary name in the same folder, then rename.

Temporary names hold host and process, so that a later run finds the files of killed runs.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import platform
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nlens_video.core.errors import OutputError

_MOST_BYTES = 255  # of a file's name
_MOST_DIGITS = 10  # of a process's number


def partial_name(path: Path) -> Path:
    """Temporary name beside `path`; keeps the extension, so players open it."""
    name = f"{_before_process(path)}{os.getpid()}{path.suffix}"
    return written_through(path).with_name(name)


def stem_beside(path: Path, others: int) -> str:
    """The stem of `path` for a name beside it, shortened where that would be too long.

    Args:
        path: its suffix is part of the other name too.
        others: how long the rest of that is [byte].

    Returns:
        the stem, or its beginning and a hash of all of it, which tells long names apart.
    """
    stem = os.fsencode(path.stem)
    room = _MOST_BYTES - others - len(os.fsencode(path.suffix))
    if len(stem) <= room:
        return path.stem
    end = f"~{hashlib.sha256(stem).hexdigest()[:8]}"
    begin = stem[: max(room - len(end), 0)]
    return begin.decode(sys.getfilesystemencoding(), "ignore") + end  # no part of a character


def written_through(path: Path) -> Path:
    """The file that is written for `path`: the target of a link, which need not exist.

    Raises:
        OutputError: the link is circular.
    """
    if not path.is_symlink():
        return path
    with contextlib.suppress(OSError, RuntimeError):
        target = path.resolve()
        if not target.is_symlink():
            return target
    raise OutputError(f"{path}: is a link that leads in a circle; give another name")


def kept_name(path: Path) -> Path:
    """Name of the partial file that an aborted run keeps on request."""
    mark = ".partial"
    return path.with_name(f"{stem_beside(path, len(mark))}{mark}{path.suffix}")


def left_over(path: Path, *, whole_folder: bool = False) -> list[Path]:
    """Temporary files of `path` from ended processes of this machine.

    Args:
        path: the result, or the pattern of a sequence.
        whole_folder: include temporary files of other results with its extension.
    """
    begin = rf"\..+\.partial-{_host()}-" if whole_folder else re.escape(_before_process(path))
    shape = re.compile(rf"{begin}(\d+){re.escape(path.suffix)}")
    try:
        folder = written_through(path).parent
        names = [(one, shape.fullmatch(one.name)) for one in folder.iterdir()]
    except (OSError, OutputError):
        return []  # reported on writing
    return sorted(one for one, match in names if match and not _runs(int(match[1])))


def remove_stale(path: Path, *, whole_folder: bool = False) -> tuple[str, ...]:
    """Remove the files that `left_over` finds; a note on each."""
    notes = []
    for found in left_over(path, whole_folder=whole_folder):
        with contextlib.suppress(OSError):
            shutil.rmtree(found) if found.is_dir() else found.unlink()
            notes.append(f"removed {found.name}, left by a run that was killed")
    return tuple(notes)


def keep_last(path: Path) -> tuple[str, ...]:
    """Keep the last of the files that `left_over` finds, remove the others; a note on each."""
    found = [one for one in left_over(path) if one.stat().st_size]
    if not found:
        return remove_stale(path)
    kept = kept_name(path)
    max(found, key=lambda one: one.stat().st_mtime).replace(kept)
    return (f"what a killed run has left is now {kept}", *remove_stale(path))


def _before_process(path: Path) -> str:
    """The beginning of temporary names of `path`."""
    mark = f".partial-{_host()}-"
    return f".{stem_beside(path, 1 + len(mark) + _MOST_DIGITS)}{mark}"


def _host() -> str:
    """Host name in letters and digits: several machines may share the folder."""
    return re.sub(r"[^0-9A-Za-z]", "", platform.node())[:24] or "host"


def _runs(process: int) -> bool:
    """Whether a process exists; always true on Windows, where a signal would end it."""
    if sys.platform == "win32":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True  # of another user
    return True


def check_folder(path: Path) -> None:
    """Check that a file can be made.

    Raises:
        OutputError: the folder is missing, is read-only, or the name is that of a folder, a device
            or a pipe, or of another user's file in a folder where only its owner may replace it.
    """
    folder = written_through(path).parent
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not path.is_file():  # would be replaced by the finished file
        raise OutputError(f"{path}: is a device or a pipe; give the name of a file")
    if not folder.is_dir():
        raise OutputError(f"{path}: the folder {folder} does not exist; make it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")
    if path.exists() and _only_its_owner_replaces(path, folder):
        raise OutputError(f"{path}: belongs to another user; give another name")


def _only_its_owner_replaces(path: Path, folder: Path) -> bool:
    """Whether the sticky bit of a folder such as /tmp prevents replacing a file."""
    if sys.platform == "win32":
        return False
    about = folder.stat()
    owners = (0, about.st_uid, path.stat().st_uid)
    return bool(about.st_mode & stat.S_ISVTX) and os.geteuid() not in owners


def check_target_folder(folder: Path) -> None:
    """Check that files can be made in a folder, which need not exist.

    Raises:
        OutputError: it, or its nearest existing parent, is a file or is read-only.
    """
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir():
        raise OutputError(f"{folder}: {there} is no folder; give another one")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: the folder {there} cannot be written to")


def make_folder(folder: Path, remedy: str = "give a writable folder") -> None:
    """Make a folder with all above it, if it is missing.

    Raises:
        OutputError: it cannot be made; the message ends with what to do.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise OutputError(f"{folder}: is a file; {remedy}") from error
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); {remedy}") from error


def publish(partial: Path, path: Path) -> None:
    """Flush a finished file to the disk and rename it to its final name.

    An existing file (or the target of a link) is replaced and passes on its permissions.

    Raises:
        OutputError: the disk is full or the folder has disappeared.
    """
    with writing(path):
        bring_to_disk(partial)
        rename(partial, path)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Errors of the system within become an `OutputError` that names the path."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error


def rename(partial: Path, path: Path) -> None:
    """Give a file its final name, with owner and mode of the one that it replaces."""
    target = written_through(path)
    if target.exists():
        _take_rights(target, partial)
    try:
        partial.replace(target)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise
        _move_across(partial, target)


def bring_to_disk(path: Path) -> None:
    """Wait until a file is on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _take_rights(given: Path, taking: Path) -> None:
    """Copy owner, extended attributes (such as access lists) and mode, as far as permitted."""
    about = given.stat()
    if sys.platform != "win32":
        if (about.st_uid, about.st_gid) != (taking.stat().st_uid, taking.stat().st_gid):
            with contextlib.suppress(OSError):
                os.chown(taking, about.st_uid, about.st_gid)
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                for name in os.listxattr(given):
                    os.setxattr(taking, name, os.getxattr(given, name))
    taking.chmod(stat.S_IMODE(about.st_mode))


def _move_across(partial: Path, target: Path) -> None:
    """Move a file to another file system, where it appears when it is complete."""
    there = partial_name(target)
    try:
        shutil.copyfile(partial, there)
        bring_to_disk(there)
        if target.exists():
            _take_rights(target, there)
        there.replace(target)
    finally:
        there.unlink(missing_ok=True)
    partial.unlink()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary name to write to; rename it to `path` at the end, or discard it.

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
            raise  # of another file
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
