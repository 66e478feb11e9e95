"""Refuses commands that would write over a file that they read, or write one file twice.

Which values name files is a column of the option table (`options.files`).
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from nlens_video.core.errors import OutputError
from nlens_video.options.files import Files
from nlens_video.options.option import Option
from nlens_video.options.table import JOBS, ROWS
from nlens_video.video.named_files import NamedFiles, local_path

_URI = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.)*")')
_LISTS = {".m3u8", ".m3u", ".mpd", ".ffconcat", ".txt", ".sdp"}
_MOST_LIST_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Use:
    """Files that a command reads or writes.

    Attributes:
        name: what they are, for messages.
        given: as the user named them.
        files: the files.
        derived: whether their name is made from another file's, beside which they lie.
    """

    name: str
    given: str
    files: NamedFiles
    derived: bool = False

    @property
    def folder(self) -> bool:
        """Whether the user named their folder."""
        return bool(self.files.inside)


def file_options(command: str) -> Iterator[tuple[Option, Files]]:
    """The options of a command, or of a form of it such as `study make`, that name files."""
    return (
        (option, files) for option in ROWS if command in option.commands for files in option.files
    )


def uses(args: argparse.Namespace, role: Literal["reads", "writes"]) -> Iterator[Use]:
    """The files that a parsed command line names, to be read or to be written."""
    for option, files in file_options(_form(args)):
        if files.role != role or not files.holds(args):
            continue
        value = getattr(args, option.attribute, None)
        for given in value if isinstance(value, list) else [value]:
            path = None if given is None else local_path(str(given))
            if path is None or (files.or_word and not path.suffix):
                continue
            if files.of is not None:
                path = files.of(path)
            single = role == "reads" and not path.is_dir()  # a chunk by itself, a folder of them
            yield Use(
                files.name or option.flags[0],
                str(given),
                NamedFiles(path, () if single else files.inside),
                files.of is not None,
            )


def drop_protocol(args: argparse.Namespace) -> None:
    """Replace `file:p.mp4`, FFmpeg's form of a path, by that path, in place."""
    for attribute in {option.attribute for option, _ in file_options(_form(args))}:
        value = getattr(args, attribute, None)
        if isinstance(value, list):
            setattr(args, attribute, [_bare(one) for one in value])
        elif value is not None:
            setattr(args, attribute, _bare(value))


def _bare(given: str | Path) -> str | Path:
    path = local_path(str(given)) if str(given).startswith("file:") else None
    return given if path is None else type(given)(path)


def _form(args: argparse.Namespace) -> str:
    """The form of a command that has options of its own, else the command."""
    if args.command == "farm" and args.jobs is not None:
        return JOBS
    return f"study {args.what}" if args.command == "study" else str(args.command)


def refuse_overwriting(*commands: argparse.Namespace) -> None:
    """Check that commands write no file that they read, and none twice.

    Args:
        commands: parsed command lines; several where they run together.

    Raises:
        OutputError: they do.
    """
    taken = _Taken()
    for args in commands:
        for read in (*uses(args, "reads"), *_named_inside(args)):
            taken.add(read)
    for args in commands:
        for written in sorted(uses(args, "writes"), key=lambda use: use.folder):
            other = taken.find(written)
            if other is not None:
                raise OutputError(_line(written, other))
            taken.add(written)


class _Taken:
    """Files in use; single files are looked up in a dict, since there may be many."""

    def __init__(self) -> None:
        self._uses: list[Use] = []
        self._by_key: dict[object, Use] = {}

    def add(self, use: Use) -> None:
        self._uses.append(use)
        self._by_key.update(dict.fromkeys(use.files.keys(), use))

    def find(self, use: Use) -> Use | None:
        """An earlier use of one of the same files."""
        for key in use.files.keys():
            if key in self._by_key:
                return self._by_key[key]
        return next(
            (
                other
                for other in self._uses
                if (use.files.several or other.files.several) and use.files.meets(other.files)
            ),
            None,
        )


def _line(written: Use, other: Use) -> str:
    if written.folder:
        return (
            f"{written.name} {written.given}: is the folder of {other.name} as well; "
            "give another folder"
        )
    return f"{written.name} {written.given}: is {other.name} as well; give it another name"


def _named_inside(args: argparse.Namespace) -> Iterator[Use]:
    """Files that are read because a scene or a playlist names them."""
    scene, plate = getattr(args, "glb", None), getattr(args, "input", None)
    if scene is not None:
        for path in _beside_scene(Path(scene)):
            yield Use("a file of the scene", str(path), NamedFiles(path))
    plate_path = None if plate is None else local_path(plate)
    if plate_path is not None and plate_path.suffix.lower() in _LISTS:
        for path in _listed(plate_path):
            yield Use("a file of the plate", str(path), NamedFiles(path))


def _beside_scene(scene: Path) -> Iterator[Path]:
    """Buffers and images that a .gltf file names; a broken file is reported where it is loaded."""
    if scene.suffix.lower() != ".gltf":
        return
    try:
        text = scene.read_bytes()
    except OSError:
        return
    for match in _URI.finditer(text):
        try:
            name = str(json.loads(match[1]))
        except ValueError:
            continue
        if not name.startswith("data:"):
            yield scene.parent / unquote(name)


def _listed(plate: Path) -> Iterator[Path]:
    """Files that a playlist names, bare or in quotes."""
    try:
        if plate.stat().st_size > _MOST_LIST_BYTES:
            return
        lines = plate.read_text(errors="replace").splitlines()
    except OSError:
        return
    for line in lines:
        for name in {line.strip(), *re.split(r"[\s'\"<>]+", line), *re.findall(r"'([^']+)'", line)}:
            path = local_path(name) if name else None
            if path is not None and len(name) < 255 and (plate.parent / path).is_file():
                yield plate.parent / path
