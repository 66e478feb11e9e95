"""What the commands that measure share: their folder and their progress."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from nlens_video.core.errors import OutputError, UsageError
from nlens_video.core.stdio import print_out
from nlens_video.video.atomic_files import check_target_folder, replacing

T = TypeVar("T")


class Progress:
    """Progress on standard error, where a person looks at it."""

    def __init__(self, *, quiet: bool) -> None:
        from rich.console import Console

        self._console = Console(stderr=True)
        self._hidden = quiet or not self._console.is_terminal

    def track(self, items: Sequence[T], what: str) -> Iterable[T]:
        """The items, a bar meanwhile."""
        from rich.progress import track

        return track(items, what, console=self._console, transient=True, disable=self._hidden)


def tell_and_write(text: str, write: Callable[[], None] | None, *, quiet: bool) -> None:
    """Print what was measured, and write it; each is done whatever becomes of the other.

    Args:
        text: what is printed.
        write: writes the files, None where none are asked for.
        quiet: print nothing.

    Raises:
        OutputError: one of the two could not be done.
    """
    try:
        if not quiet:
            print_out(text)
    finally:
        if write is not None:
            write()


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder.

    Args:
        folder: is there.
        texts: what each file holds, by its name.

    Raises:
        OutputError: one of them cannot be written.
    """
    for name, text in texts.items():
        with replacing(folder / name) as partial:
            partial.write_text(text, encoding="utf-8")


def check_matplotlib() -> None:
    """See that plots can be made, and keep matplotlib's advice off the screen.

    Raises:
        UsageError: matplotlib is not installed.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("--out needs matplotlib, which is not installed; pip install matplotlib")
    # without a home to write to it keeps its fonts in a temporary folder, and warns at length
    logging.getLogger("matplotlib").setLevel(logging.ERROR)


def make_folder(out: Path) -> None:
    """Make the folder of the results where it is missing.

    Raises:
        OutputError: it cannot be made.
    """
    check_target_folder(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{out}: cannot be made ({error.strerror}); give another --out"
        ) from error
