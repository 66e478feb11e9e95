"""Numbered files: `plate_%04d.png`."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

from nlens_video.core.errors import InputError

_NUMBER = re.compile(r"%(?:0?(\d+))?d")


class ImageSequence:
    """A pattern with one number in the file's name.

    Args:
        pattern: path with `%d` or `%04d` in its last part.
    """

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern
        self._path = Path(pattern)
        before, _, after = _NUMBER.sub("\0", self._path.name).partition("\0")
        self._shape = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))

    @staticmethod
    def matches(spec: str) -> bool:
        """Whether a name is such a pattern."""
        return len(_NUMBER.findall(Path(spec).name)) == 1

    def path(self, number: int) -> Path:
        """The file of a number."""
        name = _NUMBER.sub(lambda m: str(number).zfill(int(m.group(1) or 0)), self._path.name)
        return self._path.with_name(name)

    def number(self, path: Path) -> int | None:
        """The number of a file of this sequence, None for any other file."""
        number = self._named(path.name)
        if number is None or path.parent.resolve() != self._path.parent.resolve():
            return None
        return number

    def numbers(self) -> list[int]:
        """The numbers on disk, ascending; none where the folder is missing."""
        folder = self._path.parent
        names = (path.name for path in folder.iterdir()) if folder.is_dir() else ()
        return sorted(number for number in map(self._named, names) if number is not None)

    def first(self) -> int:
        """The smallest number on disk.

        Raises:
            InputError: no file fits the pattern.
        """
        return self._some()[0]

    def span(self) -> range:
        """The numbers on disk, which follow each other without a gap.

        Raises:
            InputError: no file fits the pattern, or one is missing between others.
        """
        numbers = self._some()
        for number, later in pairwise(numbers):
            if later != number + 1:
                raise InputError(
                    f"{self.path(number + 1)}: is missing, the sequence goes on with "
                    f"{self.path(later).name}; add the missing files or move the later ones away"
                )
        return range(numbers[0], numbers[-1] + 1)

    def _some(self) -> list[int]:
        numbers = self.numbers()
        if not numbers:
            raise InputError(f"{self.pattern}: no such files; expected numbered pictures")
        return numbers

    def _named(self, name: str) -> int | None:
        match = self._shape.fullmatch(name)
        if match is None:
            return None
        number = int(match.group(1))
        return number if self.path(number).name == name else None
