"""The folder in which the chunks of a run lie until its result is there."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nlens_video.core.errors import OutputError

OURS = re.compile(r"\.?([0-9a-f]{16}-\d{8}-.*\.nut|fit-[0-9a-f]{16}.*\.json)")
"""Names of chunks and fits, and of their temporaries."""


def make(folder: Path) -> None:
    """Make a folder for chunks, unless it is there.

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
def alone_in(folder: Path) -> Iterator[None]:
    """Make the folder, and hold it against a second run; a killed one lets go by itself.

    Raises:
        OutputError: it cannot be made, or another run holds it.
    """
    make(folder)
    try:
        handle = _locked(folder)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from error
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _locked(folder: Path) -> int | None:
    """What holds the folder's lock until it is closed; None on Windows, which has no such locks.

    Raises:
        OutputError: another run holds it.
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
            f"{folder}: another run is at work in it; wait for it, or give OUT another name"
        ) from error
    except OSError:
        pass  # some network file systems have no locks: there, one run at a time is the user's care
    return handle


def remove(folder: Path) -> None:
    """Remove chunks and fits; the folder too, unless something else lies in it."""
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if OURS.fullmatch(path.name):
                path.unlink()
        folder.rmdir()
