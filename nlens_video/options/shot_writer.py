"""Writing shot files: from a command line, or from tables that are edited."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from nlens_video.core.errors import OutputError
from nlens_video.options.option import Option
from nlens_video.options.readers import pattern
from nlens_video.options.shot_file import (
    LISTS,
    TABLES,
    VERSION,
    keys_of,
    place_of,
    read_tables,
    rows_of,
    words_by,
)
from nlens_video.options.shot_objects import LISTED, Tables, is_listed
from nlens_video.options.toml_words import is_number, parsed_toml, table_of, word_of
from nlens_video.video.atomic_files import replacing
from nlens_video.video.named_files import NamedFiles, exists, local_path


def save(path: Path, given: argparse.Namespace) -> None:
    """Write a shot file; the files that it names are named from its folder.

    Args:
        path: the file.
        given: of a command line, as texts, True for an option without a value (`parser.given`).

    Raises:
        OutputError: it cannot be written.
    """
    import tomlkit

    tables: Tables = {table: _entries(table, given, path) for table in TABLES}
    several = any(getattr(given, attribute, None) is not None for attribute in LISTED)
    if several:
        tables["object"] |= tables.pop("place") | _words_of_motion(given)
        others = (table_of(word) for word in getattr(given, "others", []))
        named = ({**one, "file": _beside(str(one["file"]), path)} for one in others)
        listed = {"object": [tables["object"], *named]}
        tables = {table: listed.get(table, held) for table, held in tables.items()}
    document = tomlkit.document()
    document.add("version", tomlkit.item(LISTS if several else VERSION))
    for table, entries in tables.items():
        if entries:
            document.add(table, tomlkit.item(entries))
    _write(path, tomlkit.dumps(document))


def _write(path: Path, text: str) -> None:
    """Write the text of a shot file.

    Raises:
        OutputError: it names a file that TOML cannot name, or cannot be written.
    """
    try:
        encoded = text.encode()
    except UnicodeEncodeError as error:
        raise OutputError(
            f"{path}: TOML holds UTF-8 alone, and a file that the shot names has other bytes in "
            "its name; rename that file, or save no shot"
        ) from error
    with replacing(path) as partial:
        partial.write_bytes(encoded)


def _entries(table: str, given: argparse.Namespace, path: Path) -> dict[str, Any]:
    """What a command line gives of a table."""
    entries: dict[str, Any] = {}
    for key, row in rows_of(table).items():
        value = getattr(given, row.attribute, None)
        if value is None or key != keys_of(row)[0] or not _fits(row, value):
            continue
        entries[key] = value if value is True else _plain(_named_from(row, value, path))
    return entries


def _words_of_motion(given: argparse.Namespace) -> dict[str, Any]:
    """The keys of the first object, and how it moves between them."""
    found: dict[str, Any] = {}
    if getattr(given, "interpolation", None) is not None:
        found["interpolation"] = given.interpolation
    if getattr(given, "keys", None) is not None:
        found["key"] = [table_of(word) for word in given.keys]
    return found


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

    words_by(tables, path)
    document = tomlkit.document()
    if exists(path):
        read_tables(path)
        document = tomlkit.parse(path.read_text(encoding="utf-8"))
    document["version"] = LISTS if is_listed(tables) else VERSION
    for table in TABLES:
        if isinstance(tables.get(table), list) or isinstance(document.get(table), list):
            _replace(document, table, tables.get(table))
            continue
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
    _write(path, tomlkit.dumps(document))


def _replace(document: Any, table: str, entries: object) -> None:  # noqa: ANN401  tomlkit's own
    """Put a list of tables, or what replaces one, into a document unless it is there already."""
    import tomlkit

    if table in document and document[table] == entries:
        return
    if table in document:
        del document[table]
    if entries:
        document.add(table, tomlkit.item(entries))


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
            value = parsed_toml(f"value = {text}")["value"]
        except ValueError:
            continue
        numbers = value if isinstance(value, list) else [value]
        if all(map(is_number, numbers)) and word_of(value) == word:
            return value
    return word


def _named_from(row: Option, word: str, path: Path) -> str:
    place = place_of(row, word)
    if place is None:
        return word
    files = NamedFiles(Path(pattern(str(place))))
    is_there = row.files[0].role != "reads" or any(True for _ in files.existing())
    return _from_folder(place, path) if is_there else word


def _beside(name: str, path: Path) -> str:
    """The file of an object as a shot file names it."""
    place = local_path(name)
    return name if place is None else _from_folder(place, path)


def _from_folder(place: Path, path: Path) -> str:
    return os.path.relpath(place.parent.resolve() / place.name, path.parent.resolve())
