"""Writing shot files: from a command line, or from tables that are edited."""

from __future__ import annotations

import argparse
import os
import tomllib
from pathlib import Path
from typing import Any

from nlens_video.options.option import Option
from nlens_video.options.shot_file import (
    TABLES,
    VERSION,
    Tables,
    given_by,
    is_number,
    keys_of,
    place_of,
    read_tables,
    rows_of,
    word_of,
)
from nlens_video.video.atomic_files import replacing


def save(path: Path, given: argparse.Namespace) -> None:
    """Write a shot file; the files that it names are named from its folder.

    Args:
        path: the file.
        given: of a command line, as texts, True for an option without a value (`parser.given`).

    Raises:
        OutputError: it cannot be written.
    """
    import tomlkit

    document = tomlkit.document()
    document.add("version", tomlkit.item(VERSION))
    for table in TABLES:
        entries = tomlkit.table()
        for key, row in rows_of(table).items():
            value = getattr(given, row.attribute, None)
            if value is None or key != keys_of(row)[0] or not _fits(row, value):
                continue
            entries.add(key, value if value is True else _plain(_named_from(row, value, path)))
        if entries:
            document.add(table, entries)
    with replacing(path) as partial:
        partial.write_text(tomlkit.dumps(document), encoding="utf-8")


def save_tables(path: Path, tables: Tables) -> None:
    """Write tables as a shot file; comments and order of one that is there stay.

    Args:
        path: the shot file.
        tables: as of `words_by`.

    Raises:
        UsageError: they are not those of a shot file, or what is there cannot be read.
        OutputError: it cannot be written.
    """
    import tomlkit

    given_by(tables, path)
    document = tomlkit.document()
    if path.exists():
        read_tables(path)
        document = tomlkit.parse(path.read_text(encoding="utf-8"))
    document["version"] = VERSION
    for table in TABLES:
        entries = tables.get(table, {})
        if table not in document and entries:
            document.add(table, tomlkit.table())
        held: Any = document.get(table, {})
        for key in [key for key in held if key not in entries]:
            del held[key]
        for key, value in entries.items():
            if key not in held or held[key] != value:
                held[key] = value
        if table in document and not held:
            del document[table]
    with replacing(path) as partial:
        partial.write_text(tomlkit.dumps(document), encoding="utf-8")


def _fits(row: Option, value: object) -> bool:
    """Whether a row is the one that takes a value: --range and --frame set the same attribute."""
    if not row.one_of or row.type is None:
        return True
    try:
        row.type(str(value))
    except argparse.ArgumentTypeError:
        return False
    return True


def _plain(word: str) -> object:
    """The number, list of numbers or text that reads back as a word."""
    for text in (word, f"[{word}]"):
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            continue
        numbers = value if isinstance(value, list) else [value]
        if all(map(is_number, numbers)) and word_of(value) == word:
            return value
    return word


def _named_from(row: Option, word: str, path: Path) -> str:
    place = place_of(row, word)
    if place is None or (row.files[0].role == "reads" and not place.exists()):
        return word
    return os.path.relpath(place.parent.resolve() / place.name, path.parent.resolve())
