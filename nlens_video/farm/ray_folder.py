"""What Ray would do to this process and machine: its folder, and handlers that it replaces."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from nlens_video.core.errors import OutputError

_SHORT = "/tmp"  # where Ray's files lie if the path of its own folder is too long
_SOCKET = "session_2000-01-01_00-00-00_000000_1234567/sockets/plasma_store.1"  # the longest
_MOST_BYTES = 103 if sys.platform == "darwin" else 107  # of a socket's path


@contextmanager
def ray_folder(*, local: bool) -> Iterator[str | None]:
    """A folder for the files of a local Ray, removed at the end; None where Ray's own will do.

    Ray keeps sockets among its temporary files, and a socket's path may have 107 bytes at most.

    Raises:
        OutputError: the path of Ray's own folder is too long, and no shorter one can be made.
    """
    if not local:  # no Ray begins here
        yield None
        return
    variables = ("RAY_TMPDIR", "TMPDIR") if sys.platform == "linux" else ("RAY_TMPDIR",)
    given = next((os.environ[name] for name in variables if name in os.environ), _SHORT)
    own = Path(given).absolute() / "ray" / _SOCKET
    if sys.platform == "win32" or len(os.fsencode(own)) <= _MOST_BYTES:
        yield None
        return
    try:
        folder = TemporaryDirectory(prefix="nlens-", dir=_SHORT, ignore_cleanup_errors=True)
    except OSError as error:
        most = _MOST_BYTES - len(f"/ray/{_SOCKET}")
        raise OutputError(
            f"{given}: too long a path for Ray's sockets, and {_SHORT} cannot be used "
            f"({error.strerror}); set RAY_TMPDIR to a folder whose path has at most {most} bytes"
        ) from error
    with folder as path:
        yield path


def restore_handlers(handlers: dict[signal.Signals, Any]) -> None:
    """Restore signal handlers: Ray installs its own and removes them when it ends."""
    for number, handler in handlers.items():
        if handler is not None:
            signal.signal(number, handler)
