"""Shot files: what a command line says, as TOML.

A key is an option's long name without its dashes, in the table of its kind; plate, object and
result are the keys `file` of theirs. A file becomes the words of a command line, so that both mean
the same. Its paths are relative to its own folder.
"""

from __future__ import annotations

import argparse
import os
import tomllib
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.options.option import Option
from nlens_video.options.table import ROWS
from nlens_video.video.atomic_files import replacing
from nlens_video.video.named_files import local_path

VERSION = 1
TABLES: dict[str, tuple[str, ...]] = {
    "plate": (
        "input", "range", "input_format", "input_size", "input_rate", "input_transfer", "reconnect",
    ),
    "object": (
        "glb", "scene", "camera", "layers", "ground_y", "footprint", "animation", "loop",
        "animation_speed", "animation_offset",
    ),
    "place": ("at", "at_frame", "size", "height", "yaw"),
    "camera": ("camera_from", "fov", "horizon", "marker", "person_height", "person"),
    "light": ("env", "env_rotation", "env_exposure", "sun", "shadow_strength"),
    "lens": ("lens", "aperture", "cat_eye", "fit", "fallback", "track_focus", "prefer"),
    "effects": (
        "effects", "shutter", "vignetting", "distortion", "reflect", "occlusion", "holdout",
    ),
    "quality": ("preset", "device", "budget_ms", "hold_budget", "late"),
    "output": (
        "output", "codec", "crf", "pix_fmt", "keep_partial", "report", "save_fit", "aov", "timings",
    ),
}  # fmt: skip
"""Attributes of the options that a shot file holds, by table."""
_TABLE_OF = {attribute: table for table, held in TABLES.items() for attribute in held}
_POSITIONALS = ("input", "glb", "output")
_Given = dict[str, tuple[Option, str]]
"""By attribute: the row, and the word that follows it; empty where none does."""


def _keys(row: Option) -> list[str]:
    """The keys that a row has in a shot file, today's first."""
    if not row.flags:
        return ["file"]
    return [flag.removeprefix("--") for flag in row.flags if flag.startswith("--")]


def _rows(table: str, command: str = "render") -> dict[str, Option]:
    """The rows of a table's keys."""
    return {
        key: row
        for attribute in TABLES[table]
        for row in ROWS
        if row.attribute == attribute and command in row.commands
        for key in _keys(row)
    }


def is_shot_file(word: str) -> bool:
    """Whether the first word of a command line names a shot file."""
    return word.endswith(".toml") and not word.startswith("-")


def words_of(path: Path, words: Sequence[str], command: str) -> list[str]:
    """The command line that a shot file and the words after it make.

    Args:
        path: the shot file.
        words: of `fit` the file to write; then options, which win over those of the shot file.
        command: `render`, `fit` or `farm`; options that it does not have are left out.

    Raises:
        UsageError: the file cannot be read, or is no shot file.
    """
    given = _read(path)
    named = _POSITIONALS[:2] if command == "fit" else _POSITIONALS
    for attribute in named:
        if attribute not in given:
            table = _TABLE_OF[attribute]
            raise UsageError(f'{path}: names no {table}; give file = "…" under [{table}]')
    again = {attribute for word in words for attribute in _attributes(word)}
    options = [
        f"{flag}={word}" if word else flag
        for attribute, (row, word) in given.items()
        if attribute not in again and command in row.commands
        for flag in [flag for flag in row.flags if flag.startswith("--")][:1]
    ]
    first = next((at for at, word in enumerate(words) if word.startswith("--")), len(words))
    return [*(given[one][1] for one in named), *words[:first], *options, *words[first:]]


def _attributes(word: str) -> set[str]:
    """Attributes that a word of a command line may set: options can be abbreviated."""
    name = word.partition("=")[0]
    if not name.startswith("--"):
        return set()
    return {row.attribute for row in ROWS if any(flag.startswith(name) for flag in row.flags)}


def _read(path: Path) -> _Given:
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{path}: cannot be read as a shot file ({reason})") from error
    version = tables.pop("version", None)
    if version is None or isinstance(version, bool) or version != VERSION:
        said = "says no version" if version is None else f"has version {version}"
        raise UsageError(f"{path}: {said}; a shot file begins with version = {VERSION}")
    given: _Given = {}
    for table, entries in tables.items():
        if table not in TABLES:
            raise UsageError(f"{path}: there is no table [{table}]; {_meant(table, TABLES)}")
        if not isinstance(entries, dict):
            raise UsageError(f"{path}: {table} is no table; begin it with the line [{table}]")
        for key, value in entries.items():
            row = _row(path, table, key)
            word = _word(value)
            if word is None:
                raise UsageError(
                    f"{path}: [{table}] {key}: expected a text, a number, true, false or a list of "
                    "numbers"
                )
            if row.attribute in given:
                other = _keys(given[row.attribute][0])[0]
                raise UsageError(f"{path}: [{table}] {key} and {other} exclude each other")
            if value is not False:
                given[row.attribute] = row, word
    device = "input_format" in given
    return {
        attribute: (row, _from_here(row, word, path.parent, device=device))
        for attribute, (row, word) in given.items()
    }


def _row(path: Path, table: str, key: str) -> Option:
    rows = _rows(table)
    if key in rows:
        return rows[key]
    other = next((one for one in TABLES if key != "file" and key in _rows(one)), None)
    if other is not None:
        raise UsageError(f"{path}: [{table}] {key}: belongs into [{other}]")
    raise UsageError(f"{path}: there is no {key} in [{table}]; {_meant(key, rows)}")


def _meant(given: str, names: Iterable[str]) -> str:
    near = get_close_matches(given, list(names), n=1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"


def _word(value: object) -> str | None:
    """A value as a word of a command line, empty for true and false; None: it cannot be one."""
    if isinstance(value, bool):
        return ""
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list):
        words = [repr(one) for one in value if _is_number(one)]
        return ",".join(words) if words and len(words) == len(value) else None
    return value if isinstance(value, str) and value else None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _from_here(row: Option, word: str, folder: Path, *, device: bool) -> str:
    """A word; where it names a file beside the shot file, with the way there."""
    place = _place(row, word)
    if place is None:
        return word
    here = folder / place
    other = (device and row.attribute == "input") or (row.type is not None and not place.suffix)
    if row.files[0].role == "reads" and other and not here.exists():
        return word  # a device, or a value of another kind: `plate` is an environment
    return str(here)


def _place(row: Option, word: str) -> Path | None:
    """The path that a word names, if any."""
    place = local_path(word) if row.files and word else None
    return None if place is None or (row.files[0].or_word and not place.suffix) else place


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
        for key, row in _rows(table).items():
            value = getattr(given, row.attribute, None)
            if value is None or key != _keys(row)[0] or not _fits(row, value):
                continue
            entries.add(key, value if value is True else _plain(_named_from(row, value, path)))
        if entries:
            document.add(table, entries)
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
        if all(map(_is_number, numbers)) and _word(value) == word:
            return value
    return word


def _named_from(row: Option, word: str, path: Path) -> str:
    place = _place(row, word)
    if place is None or (row.files[0].role == "reads" and not place.exists()):
        return word
    return os.path.relpath(place.parent.resolve() / place.name, path.parent.resolve())
