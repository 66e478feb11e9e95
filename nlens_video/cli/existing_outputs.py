"""Outputs that exist already: replaced, asked about, or refused.

As FFmpeg does, a command on a terminal asks before it replaces a file; `-y` answers. A script may
run the same command again; there only a write-protected file, and a report's page that another
program has written, are refused.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from nlens_video.cli.path_guard import Use, uses
from nlens_video.core.errors import OutputError
from nlens_video.core.stdio import escape_controls, standard_error
from nlens_video.options.files import PAGE

GENERATOR = "nlens-video"
"""Content of the `meta` element `generator` in the pages that are written here."""
_OUR_PAGES = (f'name="generator" content="{GENERATOR}"', '<p class="eyebrow">nlens-video')
_MOST_PAGE_BYTES = 1 << 28
_WITHOUT_ASKING = "give -y (--overwrite) to replace it, or another name"


@dataclass(frozen=True, slots=True)
class _There:
    """A file, or files of one name, that would be replaced.

    Attributes:
        name: for the question.
        foreign: why it must not be replaced unasked; empty where it may.
    """

    name: str
    foreign: str = ""


def settle_existing(*commands: argparse.Namespace, overwrite: bool) -> None:
    """Check that existing outputs may be replaced; on a terminal, ask.

    Args:
        commands: parsed command lines.
        overwrite: whether `-y` was given.

    Raises:
        OutputError: an existing file must not be replaced.
    """
    if overwrite:
        return
    there = [
        one
        for args in commands
        if not getattr(args, "plan", False)
        for use in uses(args, "writes")
        for one in _there(use)
    ]
    if there and _is_interactive():
        _ask(there)
        return
    for one in there:
        if one.foreign:
            raise OutputError(f"{one.name}: {one.foreign}; {_WITHOUT_ASKING}")


def _there(use: Use) -> Iterator[_There]:
    if use.derived or (use.folder and use.files.inside != PAGE):
        return  # all names in such a folder are this program's
    files = [path for path in use.files.existing() if path.is_file() and path.stat().st_size]
    if not files:
        return
    name = str(files[0]) if len(files) == 1 else f"{use.given} ({len(files)} files)"
    if any(map(_protected, files)):
        yield _There(name, "is write-protected")
    elif use.folder and not all(map(_is_our_page, files)):
        yield _There(name, "was not written by nlens-video")
    elif not use.folder:
        yield _There(name)


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


def _is_interactive() -> bool:
    """Whether standard input and standard error are a terminal."""
    return all(one is not None and one.isatty() for one in (sys.stdin, sys.stderr))


def _ask(there: list[_There]) -> None:
    """Ask once for all files.

    Raises:
        OutputError: the answer is no.
    """
    names = ", ".join(f"{one.name} {one.foreign}".strip() for one in there)
    exists = " exists" if len(there) == 1 else " exist"
    if all(one.foreign for one in there):
        exists = ""
    error = standard_error()
    error.write(f"nlens-video: {escape_controls(names)}{exists}; replace? [y/N] ")
    error.flush()
    answer = sys.stdin.readline()
    if not answer.endswith("\n"):
        error.write("\n")
    if answer.strip().lower() not in ("y", "yes"):
        raise OutputError(f"{there[0].name}: exists, and is kept; give another name, or -y")
