"""The commands that the public pages show."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from support.folders import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
_OF_A_LOOP = re.compile(r"frames=|length=|for |  nlens-video .*\$first|done$")


def blocks(page: Path) -> Iterator[str]:
    """A page's blocks of commands."""
    for language, block in _BLOCK.findall(page.read_text(encoding="utf-8")):
        if language in {"", "bash"}:
            yield block


def commands(pages: Iterable[Path] = PAGES) -> list[str]:
    """Each line of the pages that is a command by itself; without a comment behind it."""
    lines = [line for page in pages for block in blocks(page) for line in block.splitlines()]
    alone = [line.split("  #")[0].strip() for line in lines if not _OF_A_LOOP.match(line)]
    return list(dict.fromkeys(alone))
