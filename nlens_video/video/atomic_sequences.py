"""Sequences whose files get their final names all or none."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from nlens_video.core import signals
from nlens_video.core.errors import OutputError
from nlens_video.video.atomic_files import bring_to_disk, rename, writing, written_through


def publish_all(files: Sequence[tuple[Path, Path]], name: str) -> None:
    """Flush finished files to the disk, then rename all of them, whatever interrupts, or none.

    Args:
        files: temporary and final name of each.
        name: of all together, for notes.

    Raises:
        OutputError: the disk is full, or the folder has disappeared or cannot be written any more;
            what was there before is there again, else the message says what is new.
        KeyboardInterrupt: a signal came; with a note if all files have their names already.
    """
    for partial, path in files:
        with writing(path):
            bring_to_disk(partial)
    complete = False
    try:
        with _uninterrupted():
            _rename_all(files)
            complete = bool(files)
    except KeyboardInterrupt as interrupt:
        if complete:
            interrupt.add_note(f"{name} is complete")
        raise


def _rename_all(files: Sequence[tuple[Path, Path]]) -> None:
    renamed = []
    try:
        for partial, path in files:
            with writing(path):
                existed = _keep_former(partial, path)
                rename(partial, path)
            renamed.append((partial, path, existed))
    except OutputError as error:
        left = [path for one, path, existed in renamed if not _undone(one, path, existed=existed)]
        if not left:
            raise
        names = left[0].name if len(left) == 1 else f"{left[0].name} to {left[-1].name}"
        raise OutputError(f"{error}; already there: {names}") from error
    finally:
        for partial, _ in files:
            with contextlib.suppress(OSError):
                _former(partial).unlink(missing_ok=True)


def _former(partial: Path) -> Path:
    """A second name for the file that one replaces."""
    return partial.with_name(f"{partial.name}.former")


def _keep_former(partial: Path, path: Path) -> bool:
    """Keep the file that is replaced, where the file system has links; whether there is one."""
    target = written_through(path)
    if not target.exists():
        return False
    with contextlib.suppress(OSError):
        os.link(target, _former(partial))
    return True


def _undone(partial: Path, path: Path, *, existed: bool) -> bool:
    """Give a file its temporary name again; whether what was there before is there again."""
    try:
        target = written_through(path)
        if not existed:
            target.replace(partial)
        elif _former(partial).exists():
            with contextlib.suppress(OSError):
                os.link(target, partial)  # for --keep-partial
            _former(partial).replace(target)
        else:
            return False
    except OSError:
        return False
    return True


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Hold termination signals back until the end; they are raised there."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals interrupt the main thread alone
        return
    arrived: list[int] = []
    before = {number: signal.getsignal(number) for number in signals.ENDING}
    held = {number: one for number, one in before.items() if one not in (None, signal.SIG_IGN)}
    for number in held:
        signal.signal(number, lambda number, _: arrived.append(number))
    try:
        yield
    finally:
        for number, handler in held.items():
            signal.signal(number, handler)
        if arrived:
            signal.raise_signal(arrived[0])
