"""Which files commands may write: none that they read, none twice, existing ones only on purpose.

Which values name files is a column of the option table (`options.files`). As FFmpeg does, a command
on a terminal asks before it replaces a file; `-y` answers. A script may run the same command again;
there only a write-protected file, and a report's page that another program has written, are
refused, and a shot file's own result that a part of its frames would replace.
"""

from __future__ import annotations

import os
import stat
import sys
from argparse import Namespace
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Literal

from msgspec import Struct

from nlens_video.core.errors import OutputError, UsageError
from nlens_video.core.stdio import escape_controls, standard_error
from nlens_video.options.commands import JOBS
from nlens_video.options.files import PAGE, Files, beside_scene, listed
from nlens_video.options.option import Option
from nlens_video.options.table import ROWS
from nlens_video.video.named_files import NamedFiles, is_file, is_folder, local_path

GENERATOR = "nlens-video"
"""Content of the `meta` element `generator` in the pages that are written here."""
_OUR_PAGES = (f'name="generator" content="{GENERATOR}"', '<p class="eyebrow">nlens-video')
_MOST_PAGE_BYTES = 1 << 28


class Use(Struct, frozen=True):
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


def uses(args: Namespace, role: Literal["reads", "writes"]) -> Iterator[Use]:
    """The files that a parsed command line names, to be read or to be written."""
    for option, files in file_options(_form(args)):
        if files.role != role or not files.holds(args):
            continue
        value = getattr(args, option.attribute, None)
        for given in value if isinstance(value, list) else [value]:
            path = None if given is None else local_path(str(given))
            if path is None or files.is_word(path):
                continue
            if files.of is not None:
                path = files.of(path)
            single = role == "reads" and not is_folder(path)  # a chunk by itself, a folder of them
            yield Use(
                files.name or option.flags[0],
                str(given),
                NamedFiles(path, () if single else files.inside),
                files.of is not None,
            )


def drop_protocol(args: Namespace) -> None:
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


def _form(args: Namespace) -> str:
    """The form of a command that has options of its own, else the command."""
    if args.command == "farm" and args.jobs is not None:
        return JOBS
    return f"study {args.what}" if args.command == "study" else str(args.command)


def check_outputs(*commands: Namespace, overwrite: bool) -> None:
    """Check that commands write no file that they read, none twice, and may replace existing ones.

    Args:
        commands: parsed command lines; several where they run together.
        overwrite: whether existing files may be replaced without asking.

    Raises:
        OutputError: they may not run.
        UsageError: the only one would replace a shot file's result by a part of it.
    """
    _refuse_collisions(commands)
    if not overwrite:
        if len(commands) == 1:  # a list of shots says on purpose what becomes what
            _refuse_part(commands[0])
        _settle_existing(commands)


def _refuse_collisions(commands: tuple[Namespace, ...]) -> None:
    taken = _Taken()
    for args in commands:
        for read in (*uses(args, "reads"), *_named_inside(args), *_redirected(args, "reads")):
            taken.add(read)
    for args in commands:
        writes = (*_redirected(args, "writes"), *uses(args, "writes"))
        for written in sorted(writes, key=lambda use: use.folder):
            _check_reachable(written)
            other = taken.find(written)
            if other is not None:
                raise OutputError(_line(written, other))
            taken.add(written)


def _check_reachable(written: Use) -> None:
    path = written.files.path
    try:
        _ = next(path.iterdir(), None) if written.folder and is_folder(path) else path.lstat()
    except PermissionError:
        where = f"{written.name} {written.given}: a folder on the way may not be entered"
        raise OutputError(f"{where}; choose another") from None
    except OSError:
        pass  # new, or told where it is written


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


def _redirected(args: Namespace, role: Literal["reads", "writes"]) -> Iterator[Use]:
    """The file that a standard stream is redirected to, where the plate or the result is one."""
    attribute, stream, number = {
        "reads": ("input", "standard input", 0), "writes": ("output", "standard output", 1)
    }[role]  # fmt: skip
    if getattr(args, attribute, None) != "-":
        return
    with suppress(OSError):  # closed
        if stat.S_ISREG(os.fstat(number).st_mode):
            yield Use(stream, "-", NamedFiles(Path(f"/dev/fd/{number}")))


def _named_inside(args: Namespace) -> Iterator[Use]:
    """Files that are read beside those that options name."""
    shot_file = getattr(args, "shot_file", None)
    if shot_file is not None:
        yield Use("the shot file", str(shot_file), NamedFiles(shot_file))
    scene, plate = getattr(args, "glb", None), getattr(args, "input", None)
    if scene is not None:
        for path in beside_scene(Path(scene)):
            yield Use("a file of the scene", str(path), NamedFiles(path))
    for other in getattr(args, "others", None) or ():
        yield Use("an object", str(other.glb), NamedFiles(other.glb))
        for path in beside_scene(other.glb):
            yield Use("a file of the scene", str(path), NamedFiles(path))
    plate_path = None if plate is None else local_path(plate)
    if plate_path is not None:
        for path in listed(plate_path):
            yield Use("a file of the plate", str(path), NamedFiles(path))


def _refuse_part(args: Namespace) -> None:
    """Refuse to replace a shot file's own result by some frames of it, such as a look at one."""
    if not getattr(args, "part_of_shot", False) or args.plan:
        return
    for result in uses(args, "writes"):
        if result.name == "the result" and any(_existing(result)):
            raise UsageError(
                f"{result.given}: exists, and would be replaced by a part of {args.shot_file}; "
                f"give the part another OUT, nlens-video {args.shot_file} OUT, or --overwrite"
            )


def _settle_existing(commands: tuple[Namespace, ...]) -> None:
    existing = [
        one
        for args in commands
        for use in uses(args, "writes")
        if use.name == "--save-shot" or not getattr(args, "plan", False)
        for one in _existing(use)
    ]
    if existing and all(one is not None and one.isatty() for one in (sys.stdin, sys.stderr)):
        _ask(existing)
        return
    for name, reason in existing:
        if reason:
            raise OutputError(
                f"{name}: {reason}; give -y (--overwrite) to replace it, or another name"
            )


def _existing(use: Use) -> Iterator[tuple[str, str]]:
    """What would be replaced, and why it must not be unasked; empty where it may."""
    if use.derived or (use.folder and use.files.inside != PAGE):
        return  # all names in such a folder are this program's
    files = [path for path in use.files.existing() if is_file(path) and path.stat().st_size]
    if not files:
        return
    name = str(files[0]) if len(files) == 1 else f"{use.given} ({len(files)} files)"
    if any(map(_protected, files)):
        yield name, "is write-protected"
    elif use.folder and not all(map(_is_our_page, files)):
        yield name, "was not written by nlens-video"
    elif not use.folder:
        yield name, ""


def _protected(path: Path) -> bool:
    """Whether the file is write-protected; root may write it all the same."""
    return not path.stat().st_mode & 0o222 or not os.access(path, os.W_OK)


def _is_our_page(path: Path) -> bool:
    try:
        if path.stat().st_size > _MOST_PAGE_BYTES:
            return False
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return any(mark in text for mark in _OUR_PAGES)


def _ask(existing: list[tuple[str, str]]) -> None:
    """Ask once for all files.

    Raises:
        OutputError: the answer is no.
    """
    names = ", ".join(f"{name} {reason}".strip() for name, reason in existing)
    exists = " exists" if len(existing) == 1 else " exist"
    if all(reason for _, reason in existing):
        exists = ""
    error = standard_error()
    error.write(f"nlens-video: {escape_controls(names)}{exists}; replace? [y/N] ")
    error.flush()
    answer = sys.stdin.readline()
    if not answer.endswith("\n"):
        error.write("\n")
    if answer.strip().lower() not in ("y", "yes"):
        raise OutputError(f"{existing[0][0]}: exists, and is kept; give another name, or -y")
