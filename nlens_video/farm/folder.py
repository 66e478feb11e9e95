"""The folder that holds the chunks and the fit of a run until they are merged."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nlens_video.core.errors import OutputError

FARM_FILES = re.compile(r"\.?([0-9a-f]{16}-\d{8}-.*\.nut|fit-[0-9a-f]{16}.*\.json)")
"""Names of chunks and fits, and of their temporaries."""


def create(folder: Path) -> None:
    """Create a folder for chunks, if missing.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise OutputError(f"{folder}: is a file; name a folder for the chunks") from error
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror})") from error


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Create the folder and lock it against a second run; the lock ends with the process.

    Raises:
        OutputError: it cannot be created, or another run has locked it.
    """
    create(folder)
    try:
        handle = _lock(folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from error
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _lock(folder: Path) -> int | None:
    """File descriptor that holds the lock until it is closed; None on Windows, without `flock`.

    Raises:
        OutputError: another run has locked it.
        OSError: the folder cannot be opened.
    """
    if sys.platform == "win32":
        return None
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise OutputError(
            f"{folder}: another run is using it; wait for it, or give OUT another name"
        ) from error
    except OSError:
        pass  # some network file systems have no locks: users must not start two runs there
    return handle


def remove(folder: Path) -> None:
    """Remove chunks and fits, and the folder if it is then empty."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if FARM_FILES.fullmatch(path.name):
                path.unlink()
        folder.rmdir()
