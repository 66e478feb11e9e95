"""Shot files of several objects, or of keys: `[[object]]` in place of `[object]` and `[place]`.

The first one takes what those two tables take. It becomes the same words of a command line, its
keys become `--key`, and each other object `--object`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from nlens_video.core.errors import UsageError
from nlens_video.options.object_tables import OBJECT, further_object, place_keys
from nlens_video.options.toml_words import inline, meant
from nlens_video.video.named_files import local_path

LISTED = {"keys": "key", "interpolation": "interpolation", "others": "object"}
"""Attributes of the options that only `[[object]]` says, and their long names."""
Tables = dict[str, Any]
"""Content of a shot file: by table, then by key."""


def apart(
    tables: Tables, path: Path, keys_of_table: Callable[[str], Iterable[str]]
) -> tuple[Tables, list[tuple[str, str]]]:
    """The tables with the first object in `[object]` and `[place]`, and the words of the rest.

    Args:
        tables: of a shot file, without its version.
        path: the shot file, from whose folder files are named.
        keys_of_table: names of the keys that a table of one object may have.

    Returns:
        Tables without a list, and pairs of an attribute of `LISTED` and a word.

    Raises:
        UsageError: there is something that no object has, or a key or further object makes no
            sense.
    """
    listed = tables.get("object")
    if not isinstance(listed, list):
        return tables, []
    if "place" in tables:
        raise UsageError(f"{path}: [place] is of a single [object]; give its keys in [[object]]")
    if not listed or not all(isinstance(one, dict) for one in listed):
        raise UsageError(f"{path}: object is no list of tables; begin each with [[object]]")
    first, *others = listed
    held = {table: set(keys_of_table(table)) for table in ("object", "place")}
    names = [*OBJECT, *sorted((held["object"] | held["place"]) - set(OBJECT)), "key"]
    _check_names(first, names, f"{path}: [[object]] 1", keys_of_table)
    plain = {
        **tables,
        **{table: {k: v for k, v in first.items() if k in held[table]} for table in held},
    }
    words = _words_of_keys(first, f"{path}: [[object]] 1")
    for number, other in enumerate(others, 2):
        where = f"{path}: [[object]] {number}"
        alone = next((name for name in other if name in names and name not in (*OBJECT, "key")), "")
        if alone:
            raise UsageError(f"{where}: {alone} is of the shot; give it in the first [[object]]")
        _check_names(other, [*OBJECT, "key"], where, keys_of_table)
        try:
            further_object(other)
        except UsageError as error:
            raise UsageError(f"{where}: {error}") from error
        words.append(("others", inline({**other, "file": str(file_of(other, path))})))
    return plain, words


def file_of(table: Mapping[str, Any], path: Path) -> Path:
    """The file of an object of a shot file."""
    name = str(table["file"])
    return path.parent / (local_path(name) or name)


def is_listed(tables: Tables) -> bool:
    """Whether a shot file has `[[object]]`."""
    return isinstance(tables.get("object"), list)


def first_object(tables: Tables) -> dict[str, Any]:
    """The table of the first object, which is made where there is none."""
    if is_listed(tables) and tables["object"]:
        return cast("dict[str, Any]", tables["object"][0])
    return cast("dict[str, Any]", tables.setdefault("object", {}))


def _words_of_keys(first: Mapping[str, Any], where: str) -> list[tuple[str, str]]:
    interpolation = first.get("interpolation", "smooth")
    keys = first.get("key", [])
    try:
        place_keys(keys, interpolation).check_beside(
            [name for name in ("at", "size", "height", "yaw") if name in first]
        )
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error
    words = [("keys", inline(key)) for key in keys]
    return [*words, ("interpolation", str(interpolation))] if "interpolation" in first else words


def _check_names(
    given: Mapping[str, Any],
    names: Iterable[str],
    where: str,
    keys_of_table: Callable[[str], Iterable[str]],
) -> None:
    for name in given:
        if name in names:
            continue
        for table in ("camera", "light", "lens", "effects", "quality"):
            if name in keys_of_table(table):
                raise UsageError(f"{where}: {name} belongs into [{table}]")
        raise UsageError(f"{where}: there is no {name}; {meant(name, names)}")
