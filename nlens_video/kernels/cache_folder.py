"""Where compiled kernels are kept: where numba keeps them, else in a folder for temporary files.

numba keeps a kernel beside its module, or in the user's cache folder (`~/.cache/numba`). In a
container, a service or a shared installation neither may be writable, and numba then refuses to
compile what is to be kept. It loads what is kept as a pickle, that is as code, so a folder in a
place where everyone may write must be this user's alone.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numba
from numba.core.dispatcher import Dispatcher

ENOUGH = 64 << 20
"""Free space that a folder must have; the kernels take about 10 MB [bytes]."""

_notes: list[str] = []


def settle() -> None:
    """Let numba keep kernels where that can be done; call it before any of them is declared."""
    if _numba_finds_a_place():
        return
    folder = next(_private_folders(), None)
    if folder is None:
        # numba has no switch for this
        Dispatcher.enable_caching = _keep_nothing  # type: ignore[method-assign, assignment]
        _notes.append(
            "kernels are not kept, so each run compiles them again: neither the package, "
            "the home folder nor the temporary folder can be written; give NUMBA_CACHE_DIR"
        )
        return
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]  # made when it is imported
    _notes.append(
        f"kernels are kept in {folder}, as neither the package nor the home folder can be "
        "written; NUMBA_CACHE_DIR names another folder"
    )


def _numba_finds_a_place() -> bool:
    named = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    if not named and not os.path.isabs(os.path.expanduser("~")):  # noqa: PTH111, PTH117
        return False  # a user without a home: numba would make a folder named ~ where it is
    try:
        numba.njit(cache=True)(_no_kernel)
    except RuntimeError:
        return False
    return True


def _keep_nothing(dispatcher: Dispatcher) -> None:
    """Stands for the method by which a kernel is given its cache."""


def notes() -> tuple[str, ...]:
    """What a person should know: a folder that is not the usual one."""
    return tuple(_notes)


def _no_kernel() -> None:
    """Stands for the kernels, which lie in the same folder."""


def _private_folders() -> Iterator[Path]:
    """Folders of this user alone, made where missing, with enough room."""
    for parent in dict.fromkeys([_temporary_folder(), "/var/tmp", "/dev/shm"]):
        if parent is None:
            continue
        folder = Path(parent) / f"nlens-video-{os.geteuid()}"
        if _made_private(folder) and shutil.disk_usage(folder).free >= ENOUGH:
            yield folder


def _temporary_folder() -> str | None:
    try:
        return tempfile.gettempdir()
    except FileNotFoundError:
        return None


def _made_private(folder: Path) -> bool:
    """Whether the folder is there, is no link, is this user's, and nobody else may enter it."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return (
        stat.S_ISDIR(found.st_mode)
        and found.st_uid == os.geteuid()
        and not stat.S_IMODE(found.st_mode) & 0o077
    )
