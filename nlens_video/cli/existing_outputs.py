"""What is there already where a command is to write: replaced, asked about, or left alone.

As FFmpeg does, a command asks on a terminal before it replaces a file, and `-y` answers for it. A
script may run the same command again and again; it is refused only what is not ours to replace: a
file that is write-protected, and a report's page that something else has written.
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
"""What our pages say that made them, in a `meta` element."""
_OUR_PAGES = (f'name="generator" content="{GENERATOR}"', '<p class="eyebrow">nlens-video')
_MOST_PAGE_BYTES = 1 << 28
_WITHOUT_ASKING = "give -y (--overwrite) to replace it, or another name"


@dataclass(frozen=True, slots=True)
class _There:
    """A file, or files of one name, that would be replaced.

    Attributes:
        words: what it is, for a question.
        foreign: why it is not ours to replace; empty where it is.
    """

    words: str
    foreign: str = ""


def settle_existing(*commands: argparse.Namespace, overwrite: bool) -> None:
    """See that what commands write may replace what is there; ask, where somebody can answer.

    Args:
        commands: words of the command line.
        overwrite: whether `-y` was given.

    Raises:
        OutputError: it must not be replaced.
    """
    if overwrite:
        return
    there = [
        one
        for words in commands
        if not getattr(words, "plan", False)
        for use in uses(words, "writes")
        for one in _there(use)
    ]
    if there and _somebody_answers():
        _ask(there)
        return
    for one in there:
        if one.foreign:
            raise OutputError(f"{one.words}: {one.foreign}; {_WITHOUT_ASKING}")


def _there(use: Use) -> Iterator[_There]:
    if use.derived or (use.folder and use.files.inside != PAGE):
        return  # the names in such folders are ours
    files = [path for path in use.files.existing() if path.is_file() and path.stat().st_size]
    if not files:
        return
    words = str(files[0]) if len(files) == 1 else f"{use.given} ({len(files)} files)"
    if any(map(_protected, files)):
        yield _There(words, "is write-protected")
    elif use.folder and not all(map(_is_our_page, files)):
        yield _There(words, "was not written by nlens-video")
    elif not use.folder:
        yield _There(words)


def _protected(path: Path) -> bool:
    """Whether somebody has taken away the right to write it; root needs no right."""
    return not path.stat().st_mode & 0o222 or not os.access(path, os.W_OK)


def _is_our_page(path: Path) -> bool:
    try:
        if path.stat().st_size > _MOST_PAGE_BYTES:
            return False
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return any(mark in text for mark in _OUR_PAGES)


def _somebody_answers() -> bool:
    """Whether a person sits at both ends of the question."""
    return all(one is not None and one.isatty() for one in (sys.stdin, sys.stderr))


def _ask(there: list[_There]) -> None:
    """Ask once for all of them.

    Raises:
        OutputError: the answer is no.
    """
    names = ", ".join(f"{one.words} {one.foreign}".strip() for one in there)
    told = "" if all(one.foreign for one in there) else (" exists" if len(there) == 1 else " exist")
    error = standard_error()
    error.write(f"nlens-video: {escape_controls(names)}{told}; replace? [y/N] ")
    error.flush()
    answer = sys.stdin.readline()
    if not answer.endswith("\n"):
        error.write("\n")
    if answer.strip().lower() not in ("y", "yes"):
        raise OutputError(f"{there[0].words}: is left as it is; give another name, or -y")
