"""Storage of chunks and fits: a shared folder, or a URL that fsspec opens.

Names are content-addressed and files appear complete, so an existing file never changes.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from nlens_video.core.errors import InputError, NlensError, OutputError, UsageError
from nlens_video.video.atomic_files import make_folder, partial_name
from nlens_video.video.chunk_file import ChunkFile

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

NAME_A_FOLDER = "name a folder for the chunks"
"""What to do where a folder for chunks cannot be made."""
_FARM_FILES = re.compile(
    r"\.?([0-9a-f]{16}-\d{8}-.*\.nut|fit-[0-9a-f]{16}.*\.json|front-[0-9a-f]{16}.*\.npz)"
)
"""Names of chunks, fits and what moves in front, and of their temporaries."""
_OBJECTS = {"s3", "s3a", "gs", "gcs", "az", "abfs", "adl", "oss", "oci", "memory"}
"""Protocols whose uploads are atomic; elsewhere files are renamed at the end."""


class FolderInUse(OutputError):
    """Another run has locked the folder."""


class Folder(Struct, frozen=True):
    """A folder with the same absolute path on all machines.

    Attributes:
        local: the folder, in which files are written before `put`.
        poll_s: polling interval while waiting for a file [s].
    """

    local: Path
    poll_s: float = 0.1

    @contextmanager
    def held(self) -> Iterator[None]:
        """Create the folder and lock it against a second run; the lock ends with the process.

        What was created and is empty at the end is removed.

        Raises:
            FolderInUse: another run has locked it.
            OutputError: it cannot be created.
        """
        created = not self.local.exists()
        make_folder(self.local, NAME_A_FOLDER)
        try:
            handle = _lock(self.local)
        except OSError as error:
            raise OutputError(f"{self.local}: cannot be written ({error.strerror})") from error
        try:
            yield
        finally:
            if created:
                with contextlib.suppress(OSError):  # not empty
                    self.local.rmdir()
            if handle is not None:
                os.close(handle)

    def has(self, name: str) -> bool:
        """Whether a complete file exists; a chunk also has to match its name."""
        path = self.local / name
        if not path.is_file() or path.suffix != ".nut":
            return path.is_file()
        try:
            return ChunkFile(path).mark.file_name == name
        except NlensError:
            return False

    def existing(self, names: Iterable[str]) -> set[str]:
        """The names for which `has` is true."""
        return {name for name in names if self.has(name)}

    def has_any(self) -> bool:
        """Whether a complete file of a run is there: a chunk, or what all chunks need."""
        return any(_FARM_FILES.fullmatch(path.name) for path in self.local.glob("[!.]*"))

    def put(self, name: str) -> None:
        """Publish a file of `local`: in a folder, it is published once it is written."""

    def fetch(self, name: str) -> Path:
        """Path of a file on this machine."""
        return self.local / name

    def forget(self, name: str) -> None:
        """Remove what `fetch` has downloaded: here nothing."""

    def clear(self) -> None:
        """Remove chunks and fits, and the folder if it is then empty."""
        with contextlib.suppress(OSError):
            for path in self.local.iterdir():
                if _FARM_FILES.fullmatch(path.name):
                    path.unlink()
            self.local.rmdir()


def _lock(folder: Path) -> int | None:
    """File descriptor that holds the lock until it is closed; None on Windows, without `flock`.

    Raises:
        FolderInUse: another run has locked it.
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
        raise FolderInUse(
            f"{folder}: another run is using it; wait for it, or give OUT another name"
        ) from error
    except OSError:
        pass  # some network file systems have no locks: users must not start two runs there
    return handle


class Bucket(Struct, frozen=True):
    """A URL that fsspec opens, such as an object store.

    Attributes:
        url: of a folder or a prefix, `s3://bucket/shot`.
    """

    url: str
    poll_s: float = 1.0

    @property
    def local(self) -> Path:
        """Temporary folder of this URL."""
        name = hashlib.sha256(self.url.encode("utf-8", "surrogateescape")).hexdigest()[:16]
        return Path(tempfile.gettempdir()) / f"nlens-video-{name}"

    @contextmanager
    def held(self) -> Iterator[None]:
        """Create the prefix; URLs have no locks, so users must not start two runs in one."""
        with self._opened(OutputError, "be made") as (files, folder):
            files.makedirs(folder, exist_ok=True)
        yield

    def has(self, name: str) -> bool:
        """Whether a file exists."""
        with self._opened(InputError, "be read") as (files, folder):
            return bool(files.exists(f"{folder}/{name}"))

    def existing(self, names: Iterable[str]) -> set[str]:
        """The existing files, by one listing, since each request is slow."""
        with self._opened(InputError, "be read") as (files, folder):
            found = {str(path).rsplit("/", 1)[-1] for path in files.find(folder, maxdepth=1)}
        return found.intersection(names)

    def put(self, name: str) -> None:
        """Upload a file of `local` and remove it there."""
        path = self.local / name
        with self._opened(OutputError, "be written") as (files, folder):
            protocols = files.protocol
            if _OBJECTS.intersection([protocols] if isinstance(protocols, str) else protocols):
                files.put_file(str(path), f"{folder}/{name}")
            else:
                partial = f"{folder}/{partial_name(path).name}"
                files.put_file(str(path), partial)
                files.mv(partial, f"{folder}/{name}")
        path.unlink()

    def fetch(self, name: str) -> Path:
        """Download a file, unless it was downloaded before."""
        path = self._fetched / name
        if path.is_file():
            return path
        self._fetched.mkdir(parents=True, exist_ok=True)
        partial = partial_name(path)
        with self._opened(InputError, "be read") as (files, folder):
            files.get_file(f"{folder}/{name}", str(partial))
        return partial.replace(path)

    def forget(self, name: str) -> None:
        """Remove the download."""
        (self._fetched / name).unlink(missing_ok=True)

    def clear(self) -> None:
        """Remove chunks and fits from the URL and from this machine."""
        with self._opened(OutputError, "be emptied") as (files, folder):
            found = [str(path) for path in files.ls(folder, detail=False)]
            for path in found:
                if _FARM_FILES.fullmatch(path.rsplit("/", 1)[-1]):
                    files.rm_file(path)
        Folder(self._fetched).clear()
        Folder(self.local).clear()

    @property
    def _fetched(self) -> Path:
        return self.local / "fetched"  # apart from files being written

    @contextmanager
    def _opened(
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


Store = Folder | Bucket
"""Files that all workers share; a value that can be pickled."""


def store_of(spec: str) -> Store:
    """The store at a path or URL."""
    return Bucket(spec.rstrip("/")) if "://" in spec else Folder(Path(spec).absolute())


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
