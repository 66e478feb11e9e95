"""Numbered files: `plate_%04d.png`."""

from __future__ import annotations

import re
from pathlib import Path

from nlens_video.errors import InputError

_NUMBER = re.compile(r"%(?:0?(\d+))?d")


class Numbered:
    """A pattern with one number in the file's name.

    Args:
        pattern: path with `%d` or `%04d` in its last part.
    """

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern
        self._path = Path(pattern)

    @staticmethod
    def matches(spec: str) -> bool:
        """Whether a name is such a pattern."""
        return len(_NUMBER.findall(Path(spec).name)) == 1

    def path(self, number: int) -> Path:
        """The file of a number."""
        name = _NUMBER.sub(lambda m: str(number).zfill(int(m.group(1) or 0)), self._path.name)
        return self._path.with_name(name)

    def first(self) -> int:
        """The smallest number on disk.

        Raises:
            InputError: no file fits the pattern.
        """
        before, after = self._path.name[: self._span[0]], self._path.name[self._span[1] :]
        shape = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
        folder = self._path.parent
        names = (path.name for path in folder.iterdir()) if folder.is_dir() else ()
        found = [int(match.group(1)) for match in map(shape.fullmatch, names) if match]
        numbers = [number for number in found if self.path(number).exists()]
        if not numbers:
            raise InputError(f"{self.pattern}: no such files; expected numbered pictures")
        return min(numbers)

    @property
    def _span(self) -> tuple[int, int]:
        match = _NUMBER.search(self._path.name)
        return match.span() if match else (0, 0)
