"""The shot that the page edits: checked, read as settings, saved, and as a command line."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from nlens_video.core.errors import OutputError, UsageError
from nlens_video.core.settings import Settings
from nlens_video.options.parser import Parser, parser_of
from nlens_video.options.shot_file import files_by, read_tables, words_by
from nlens_video.options.shot_objects import Tables, first_object
from nlens_video.options.shot_writer import save_tables
from nlens_video.options.table import ROWS
from nlens_video.options.to_settings import settings
from nlens_video.video.named_files import ImageSequence, local_path

_MOST_MAPS = 100
Check = Callable[[argparse.Namespace], None]
"""Raises a NlensError where a parsed command line would write over what it reads."""
_WRITES = {row.attribute for row in ROWS for file in row.files if file.role == "writes"}


class ShotChangedError(OutputError):
    """The shot file holds what whoever would write over it has not read."""


@dataclass(slots=True)
class ShotState:
    """A shot file that is edited, and the files that its edits may name.

    Attributes:
        path: the shot file; it need not exist yet.
        tables: as they were at the start, or were read or saved last.
        check: what the command line checks of its files before it runs.
    """

    path: Path
    tables: Tables
    check: Check = lambda args: None
    _own: set[Path] = field(init=False)
    _revision: str = field(init=False)

    def __post_init__(self) -> None:
        self._own = _files(self.tables, self.path)
        self._revision = _revision(_held(self.path))

    @classmethod
    def opened(
        cls, path: Path, plate: str | None, glb: Path | None, check: Check = lambda args: None
    ) -> ShotState:
        """The shot of a file that is there, or a new one.

        Args:
            path: the shot file.
            plate: the plate; None: that of the file.
            glb: the object; None: that of the file.
            check: as of the class.

        Raises:
            UsageError: the file is no shot file, or it must exist and does not.
        """
        if not path.exists() and (plate is None or glb is None):
            raise UsageError(f"{path}: there is no such shot file; give IN and ANIM.glb too")
        tables = read_tables(path) if path.exists() else {}
        if plate is not None:
            tables.setdefault("plate", {})["file"] = _from(path.parent, str(plate))
        if glb is not None:
            first_object(tables)["file"] = _from(path.parent, str(glb))
        state = cls(path, tables, check)
        if "file" not in tables.get("output", {}) and "file" in tables.get("plate", {}):
            tables.setdefault("output", {})["file"] = _result_name(str(tables["plate"]["file"]))
            state = cls(path, tables, check)
        state.settings(tables)
        return state

    def settings(self, tables: Tables) -> Settings:
        """What an edited shot says.

        Raises:
            UsageError: it is no shot, or names a file that is neither one of the shot's own nor in
                its folder.
        """
        return settings(self._parsed(tables))

    def command(self, tables: Tables) -> str:
        """A line for a shell of this machine that renders it, in any folder, without the shot file.

        Raises:
            UsageError: as `settings`.
            OutputError: it would write over what it reads.
        """
        self._check_run(tables)
        words = words_by(tables, Path(self.path.name))  # by names from the shot's folder
        folder = shlex.join(["cd", str(self.path.parent.resolve())])
        return f"{folder} && {shlex.join(['nlens-video', *words])}"

    def read(self) -> tuple[Tables, str]:
        """The shot as it is by now, and the revision of its file.

        Tables that another program has written are taken in place of those of before; a plate, an
        object or a result that they leave out stays.

        Raises:
            UsageError: they cannot be read, or name another plate.
        """
        held = _held(self.path)
        revision = _revision(held)
        if held is not None and revision != self._revision:
            files = _files(held, self.path)
            for table in ("plate", "output"):
                held.setdefault(table, {}).setdefault("file", self.tables[table]["file"])
            first_object(held).setdefault("file", first_object(self.tables)["file"])
            if held["plate"]["file"] != self.tables["plate"]["file"]:
                raise UsageError(
                    f"{self.path}: names another plate now, {held['plate']['file']}; start the "
                    "studio again for that one"
                )
            self._own |= files
            self.tables, self._revision = held, revision
        return self.tables, revision

    def save(self, tables: Tables, revision: str | None = None) -> str:
        """Write the shot file.

        Args:
            tables: what it shall hold.
            revision: of the file that they were made from; None to write over any.

        Returns:
            the new revision.

        Raises:
            UsageError: as `settings`.
            ShotChangedError: the file has another revision.
            OutputError: it cannot be written, or what it says would write over what it reads.
        """
        self._check_run(tables)
        if revision is not None and revision != _revision(_held(self.path)):
            raise ShotChangedError(
                f"{self.path}: was changed by another page or program since this page read it; "
                "it is left as it is"
            )
        save_tables(self.path, tables)
        self.tables, self._revision = tables, _revision(_held(self.path))
        return self._revision

    def result(self, tables: Tables) -> Path | None:
        """Where a render writes its result; None where that is no file.

        Raises:
            NlensError: the command line would not run it.
        """
        self._check_run(tables)
        return files_by(tables, self.path).get("output")

    def environments(self) -> list[str]:
        """Names of the maps of light in the shot's folder, a hundred at most."""
        files = (one for one in self.path.parent.iterdir() if one.suffix.lower() == ".hdr")
        return sorted(one.name for one in files if one.is_file())[:_MOST_MAPS]

    def _check_run(self, tables: Tables) -> None:
        """Refuse what the command line would not run."""
        args = self._parsed(tables)
        settings(args)
        self.check(args)

    def _parsed(self, tables: Tables) -> argparse.Namespace:
        args = _parser().parse_args(self._words(tables))
        args.command, args.shot_file = "render", self.path
        return args

    def _words(self, tables: Tables) -> list[str]:
        words = words_by(tables, self.path)
        for attribute, path in files_by(tables, self.path).items():
            self._check(attribute, path)
        for given in (tables["plate"]["file"], tables["output"]["file"]):
            if local_path(str(given)) is None:
                raise UsageError(f"{given}: the studio reads and writes files only")
        return words

    def _check(self, attribute: str, path: Path) -> None:
        real, folder = path.resolve(), self.path.parent.resolve()
        if real == self.path.resolve():
            raise UsageError(f"{path}: is the shot file itself")
        if real in self._own or real.is_relative_to(folder):
            return
        deed = "written" if attribute in _WRITES else "read"
        raise UsageError(
            f"{path}: is not {deed}: it is none of the files that the studio was started with, and "
            f"not in the shot's folder {folder}"
        )


@cache
def _parser() -> Parser:
    return parser_of("render")


def _files(tables: Tables, path: Path) -> set[Path]:
    return {one.resolve() for one in files_by(tables, path).values()}


def _held(path: Path) -> Tables | None:
    """The tables of a shot file, None where there is none."""
    return read_tables(path) if path.exists() else None


def _revision(held: Tables | None) -> str:
    """Tells tables of a shot file from others, whatever comments they have; empty for no file."""
    if held is None:
        return ""
    return hashlib.sha256(json.dumps(held, sort_keys=True, default=str).encode()).hexdigest()


def _from(folder: Path, name: str) -> str:
    """A plate's or an object's name as the shot file in a folder gives it."""
    place = local_path(name)
    if place is None:
        return name
    return os.path.relpath(place.parent.resolve() / place.name, folder.resolve())


def _result_name(plate: str) -> str:
    """A name for the result: the plate's, beside the shot file."""
    name = Path(plate)
    if not ImageSequence.matches(name.name):
        return f"{name.stem}-composite{name.suffix or '.mp4'}"
    before, percent, number = name.name.rpartition("%")
    return f"{before.rstrip('_.-') or 'shot'}-composite.{percent}{number}"
