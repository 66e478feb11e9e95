"""Where the chunks and fits of a farm lie: a folder that all machines see, or a URL of fsspec.

Names are content-addressed and files appear whole, so a name that is there never changes.
"""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from nlens_video.core.errors import InputError, NlensError, OutputError, UsageError
from nlens_video.farm.folder import OURS, alone_in, remove
from nlens_video.video.atomic_files import partial_name
from nlens_video.video.chunks.chunk_file import ChunkFile

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

_OBJECTS = {"s3", "s3a", "gs", "gcs", "az", "abfs", "adl", "oss", "oci", "memory"}
"""Protocols whose files appear when they are whole; elsewhere they are renamed at the end."""


class Store(Protocol):
    """Files that all workers share; a value that travels to them."""

    @property
    def local(self) -> Path:
        """A folder of this machine, in which files are made before `put`."""
        ...

    @property
    def poll_s(self) -> float:
        """How often to look for a file that is waited for [s]."""
        ...

    def held(self) -> AbstractContextManager[None]:
        """Make it ready, and keep other runs out where that can be done.

        Raises:
            NlensError: it cannot be reached or written, or another run is at work in it.
        """
        ...

    def has(self, name: str) -> bool:
        """Whether a file is there, whole."""
        ...

    def there(self, names: Iterable[str]) -> set[str]:
        """Which of some files `has` would find.

        Raises:
            InputError: it cannot be asked.
        """
        ...

    def put(self, name: str) -> None:
        """Give everybody a file of `local`; it need not stay there.

        Raises:
            OutputError: it cannot be written.
        """
        ...

    def fetch(self, name: str) -> Path:
        """A file of this machine with the bytes of one that is there.

        Raises:
            InputError: it cannot be read.
        """
        ...

    def forget(self, name: str) -> None:
        """What `fetch` gave is not needed any more."""
        ...

    def clear(self) -> None:
        """Remove chunks and fits."""
        ...


def store_of(spec: str) -> Store:
    """The store that a path or a URL names."""
    return Bucket(spec.rstrip("/")) if "://" in spec else Folder(Path(spec).absolute())


@dataclass(frozen=True, slots=True)
class Folder:
    """A folder that all machines see under one absolute path."""

    local: Path
    poll_s: float = 0.1

    def held(self) -> AbstractContextManager[None]:
        """Make it, and hold it against a second run."""
        return alone_in(self.local)

    def has(self, name: str) -> bool:
        """Whether a file is there; a chunk only if it is what its name says."""
        path = self.local / name
        if not path.is_file() or path.suffix != ".nut":
            return path.is_file()
        try:
            return ChunkFile(path).mark.file_name == name
        except NlensError:
            return False

    def there(self, names: Iterable[str]) -> set[str]:
        """Which files are there."""
        return {name for name in names if self.has(name)}

    def put(self, name: str) -> None:
        """Nothing: it is there."""

    def fetch(self, name: str) -> Path:
        """The file itself."""
        return self.local / name

    def forget(self, name: str) -> None:
        """Nothing: others may want it."""

    def clear(self) -> None:
        """Remove chunks and fits, and the folder unless something else lies in it."""
        remove(self.local)


@dataclass(frozen=True, slots=True)
class Bucket:
    """What fsspec opens: object stores, file servers.

    Attributes:
        url: of a folder or a prefix, `s3://bucket/shot`.
    """

    url: str
    poll_s: float = 1.0

    @property
    def local(self) -> Path:
        """A folder for temporaries that belongs to this URL."""
        name = hashlib.sha256(self.url.encode("utf-8", "surrogateescape")).hexdigest()[:16]
        return Path(tempfile.gettempdir()) / f"nlens-video-{name}"

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the prefix; two runs in one are the user's care, since a URL has no locks."""
        with self._reached(OutputError, "be made") as (files, folder):
            files.makedirs(folder, exist_ok=True)
        yield

    def has(self, name: str) -> bool:
        """Whether a file is there."""
        with self._reached(InputError, "be read") as (files, folder):
            return bool(files.exists(f"{folder}/{name}"))

    def there(self, names: Iterable[str]) -> set[str]:
        """Which files are there, by one look at all of them: each request takes its time."""
        with self._reached(InputError, "be read") as (files, folder):
            found = {str(path).rsplit("/", 1)[-1] for path in files.find(folder, maxdepth=1)}
        return found.intersection(names)

    def put(self, name: str) -> None:
        """Upload a file of `local`, and remove it there."""
        made = self.local / name
        with self._reached(OutputError, "be written") as (files, folder):
            protocols = files.protocol
            if _OBJECTS.intersection([protocols] if isinstance(protocols, str) else protocols):
                files.put_file(str(made), f"{folder}/{name}")
            else:
                partial = f"{folder}/{partial_name(made).name}"
                files.put_file(str(made), partial)
                files.mv(partial, f"{folder}/{name}")
        made.unlink()

    def fetch(self, name: str) -> Path:
        """Download a file, unless it was."""
        path = self._fetched / name
        if path.is_file():
            return path
        self._fetched.mkdir(parents=True, exist_ok=True)
        partial = partial_name(path)
        with self._reached(InputError, "be read") as (files, folder):
            files.get_file(f"{folder}/{name}", str(partial))
        return partial.replace(path)

    def forget(self, name: str) -> None:
        """Remove what was downloaded."""
        (self._fetched / name).unlink(missing_ok=True)

    def clear(self) -> None:
        """Remove chunks and fits, there and here."""
        with self._reached(OutputError, "be emptied") as (files, folder):
            found = [str(path) for path in files.ls(folder, detail=False)]
            for path in found:
                if OURS.fullmatch(path.rsplit("/", 1)[-1]):
                    files.rm_file(path)
        remove(self._fetched)
        remove(self.local)
        with contextlib.suppress(OSError):
            self.local.rmdir()

    @property
    def _fetched(self) -> Path:
        return self.local / "fetched"  # apart from what this machine is making

    @contextmanager
    def _reached(
        self, kind: type[NlensError], what: str
    ) -> Iterator[tuple[AbstractFileSystem, str]]:
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise UsageError(
                f"{self.url}: needs fsspec; pip install nlens-video[farm], or give a folder"
            ) from error
        try:
            self.local.mkdir(parents=True, exist_ok=True)
            files, folder = url_to_fs(self.url, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            raise UsageError(f"{self.url}: cannot be opened ({_line(error)})") from error
        try:
            yield files, folder.rstrip("/")
        except Exception as error:  # each kind of storage has errors of its own
            raise kind(f"{self.url}: cannot {what} ({_line(error)})") from error


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
