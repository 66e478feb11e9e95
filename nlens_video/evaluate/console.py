"""What the commands that measure share: their folder and their progress."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from nlens_video.errors import OutputError

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


def make_folder(out: Path) -> None:
    """Make the folder of the results where it is missing.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{out}: cannot be made ({error.strerror}); give another --out"
        ) from error
