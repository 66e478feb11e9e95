"""Names of sources and results: files, numbered sequences, folders, standard streams."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path

from msgspec import Struct

from nlens_video.core.errors import InputError

DEFAULT_RATE = "24"
"""Frames per second of an image sequence without --input-rate."""
_STANDARD_INPUT = ("pipe:", "pipe:0", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0")
_STANDARD_OUTPUT = ("pipe:", "pipe:1", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")
_FILE = "file:"
_NUMBER = re.compile(r"%(?:0?(\d+))?d")


def exists(path: Path) -> bool:
    """Whether there is such a file; not as far as one can see in a folder one may not enter."""
    try:
        return path.exists()
    except PermissionError:
        return False


def is_file(path: Path) -> bool:
    """Whether there is such a regular file, as `exists`."""
    return exists(path) and path.is_file()


def is_folder(path: Path) -> bool:
    """Whether there is such a folder, as `exists`."""
    return exists(path) and path.is_dir()


def input_name(text: str) -> str:
    """A plate's name; `-` for FFmpeg's and the system's other names of standard input."""
    return "-" if text in _STANDARD_INPUT else text


def output_name(text: str) -> str:
    """A result's name; `-` for FFmpeg's and the system's other names of standard output."""
    return "-" if text in _STANDARD_OUTPUT else text


def is_utf8(path: Path) -> bool:
    """Whether a file's name is UTF-8, as some libraries ask for; others are bytes of any kind."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def local_path(spec: str) -> Path | None:
    """Path of a source or a result; None for a standard stream or a URL.

    Args:
        spec: as the user gives it; may begin with FFmpeg's protocol `file:`.
    """
    if spec.startswith(_FILE) and not exists(Path(spec)):
        spec = spec.removeprefix(_FILE)
    return None if spec == "-" or "://" in spec else Path(spec)


class ImageSequence:
    """Numbered files: a pattern such as `plate_%04d.png`.

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

    @classmethod
    def of_input(cls, spec: str) -> ImageSequence | None:
        """The sequence that an input names, None for a file, which may have such a name too."""
        return cls(spec) if cls.matches(spec) and not is_file(Path(spec)) else None

    def path(self, number: int) -> Path:
        """The file of a number."""
        name = _NUMBER.sub(lambda m: str(number).zfill(int(m.group(1) or 0)), self._path.name)
        return self._path.with_name(name)

    def number(self, path: Path) -> int | None:
        """The number of a file of this sequence, None for any other file."""
        number = self._number_of(path.name)
        if number is None or path.parent.resolve() != self._path.parent.resolve():
            return None
        return number

    def numbers(self) -> list[int]:
        """The numbers on disk, ascending; none where the folder is missing."""
        folder = self._path.parent
        names = (path.name for path in folder.iterdir()) if is_folder(folder) else ()
        return sorted(number for number in map(self._number_of, names) if number is not None)

    def first(self) -> int:
        """The smallest number on disk.

        Raises:
            InputError: no file fits the pattern.
        """
        return self._existing()[0]

    def span(self) -> range:
        """The numbers on disk, without a gap.

        Raises:
            InputError: no file fits the pattern, or one is missing between others.
        """
        numbers = self._existing()
        for number, later in pairwise(numbers):
            if later != number + 1:
                raise InputError(
                    f"{self.path(number + 1)}: is missing, the sequence goes on with "
                    f"{self.path(later).name}; add the missing files or move the later ones away"
                )
        return range(numbers[0], numbers[-1] + 1)

    def _existing(self) -> list[int]:
        numbers = self.numbers()
        if not numbers:
            raise InputError(f"{self.pattern}: no such files; expected numbered pictures")
        return numbers

    def _number_of(self, name: str) -> int | None:
        match = self._shape.fullmatch(name)
        if match is None:
            return None
        number = int(match.group(1))
        return number if self.path(number).name == name else None


class NamedFiles(Struct, frozen=True):
    """The files on disk that a name stands for.

    Attributes:
        path: a file, the `%04d` pattern of a sequence, or a folder.
        inside: shell patterns of the files in the folder `path`; empty for a file or a sequence.
    """

    path: Path
    inside: tuple[str, ...] = ()

    def existing(self) -> Iterator[Path]:
        """Those that exist."""
        if self.inside:
            found = self.path.iterdir() if is_folder(self.path) else iter(())
            yield from (one for one in found if self._is_inside(one.name))
        elif self._sequence is not None:
            yield from map(self._sequence.path, self._sequence.numbers())
        elif exists(self.path):
            yield self.path

    def holds(self, path: Path) -> bool:
        """Whether a path, which need not exist, is one of them."""
        if self.inside:
            return self._is_inside(path.name) and _resolved(path.parent) == _resolved(self.path)
        if self._sequence is not None:
            return self._sequence.number(path) is not None
        return _resolved(path) == _resolved(self.path)

    def keys(self) -> set[tuple[int, int] | Path]:
        """Identities that do not depend on names: device and inode, else the resolved path."""
        found: set[tuple[int, int] | Path] = {_identity(one) for one in self.existing()}
        return found if self.several else {*found, _resolved(self.path)}

    def meets(self, other: NamedFiles) -> bool:
        """Whether a file belongs to both, under any name; links are followed."""
        return (
            not self.keys().isdisjoint(other.keys())
            or (other.several and any(map(other.holds, self._paths())))
            or (self.several and any(map(self.holds, other._paths())))
        )

    @property
    def several(self) -> bool:
        """Whether it names a sequence or a folder."""
        return bool(self.inside) or self._sequence is not None

    @property
    def _sequence(self) -> ImageSequence | None:
        return ImageSequence.of_input(str(self.path))

    def _is_inside(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.inside)

    def _paths(self) -> list[Path]:
        """Those that exist, and the single file even if it does not."""
        return list(self.existing()) if self.several else [self.path]


def _identity(path: Path) -> tuple[int, int] | Path:
    try:
        about = path.stat()
    except OSError:  # a link to nowhere
        return path
    return about.st_dev, about.st_ino


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # links in a circle
        return path.absolute()
