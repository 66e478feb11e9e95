"""The files on disk that a name stands for: one file, a numbered sequence, or some of a folder."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from nlens_video.video.numbered import ImageSequence

_FILE = "file:"


def local_path(spec: str) -> Path | None:
    """The path that a source's or a result's name means.

    Args:
        spec: as the user gives it; `file:` in front is FFmpeg's word for a path.

    Returns:
        The path; None for a standard stream or a URL.
    """
    if spec.startswith(_FILE) and not Path(spec).exists():
        spec = spec.removeprefix(_FILE)
    return None if spec == "-" or "://" in spec else Path(spec)


@dataclass(frozen=True, slots=True)
class NamedFiles:
    """Files by their name.

    Attributes:
        path: a file, the `%04d` pattern of a sequence, or a folder.
        inside: shell patterns of the files meant, where `path` is a folder; else empty.
    """

    path: Path
    inside: tuple[str, ...] = ()

    def existing(self) -> Iterator[Path]:
        """Those of them that are there."""
        if self.inside:
            found = self.path.iterdir() if self.path.is_dir() else iter(())
            yield from (one for one in found if self._is_inside(one.name))
        elif self._sequence is not None:
            yield from map(self._sequence.path, self._sequence.numbers())
        elif self.path.exists():
            yield self.path

    def holds(self, path: Path) -> bool:
        """Whether a path, which need not exist, is the path of one of them."""
        if self.inside:
            return self._is_inside(path.name) and _resolved(path.parent) == _resolved(self.path)
        if self._sequence is not None:
            return self._sequence.number(path) is not None
        return _resolved(path) == _resolved(self.path)

    def keys(self) -> set[tuple[int, int] | Path]:
        """What tells files apart under all their names: device and inode, else the real path."""
        found: set[tuple[int, int] | Path] = {_identity(one) for one in self.existing()}
        return found if self.several else {*found, _resolved(self.path)}

    def meets(self, other: NamedFiles) -> bool:
        """Whether a file belongs to both, under whatever name: links are followed."""
        return (
            not self.keys().isdisjoint(other.keys())
            or (other.several and any(map(other.holds, self._paths())))
            or (self.several and any(map(self.holds, other._paths())))
        )

    @property
    def several(self) -> bool:
        """Whether it is the name of a sequence or of a folder."""
        return bool(self.inside) or self._sequence is not None

    @property
    def _sequence(self) -> ImageSequence | None:
        name = str(self.path)
        return (
            ImageSequence(name) if ImageSequence.matches(name) and not self.path.is_file() else None
        )

    def _is_inside(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.inside)

    def _paths(self) -> list[Path]:
        """Those there are, and the one file that may yet come."""
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
