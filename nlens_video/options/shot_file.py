"""Shot files: what a command line says, as TOML.

A key is an option's long name without its dashes, in the table of its kind; plate, object and
result are the keys `file` of theirs. A file becomes the words of a command line, so that both mean
the same. Its paths are relative to its own folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.options.option import Option
from nlens_video.options.shot_objects import LISTED, Tables, apart, file_of, is_listed
from nlens_video.options.table import ROWS
from nlens_video.options.toml_words import meant, read_toml, word_of
from nlens_video.video.named_files import exists, local_path

VERSION, LISTS = 1, 2
"""Version of files with one `[object]`, and of those with `[[object]]`."""
TABLES: dict[str, tuple[str, ...]] = {
    "plate": (
        "input", "range", "input_format", "input_size", "input_rate", "input_transfer", "reconnect",
    ),
    "object": (
        "glb", "scene", "camera", "layers", "ground_y", "footprint", "animation", "loop",
        "animation_speed", "animation_offset",
    ),
    "place": ("at", "at_frame", "size", "height", "yaw"),
    "camera": ("camera_from", "fov", "horizon", "roll", "marker", "person_height", "person",
               "ignore_lines"),
    "light": ("env", "env_rotation", "env_exposure", "sun", "shadow_strength"),
    "lens": ("lens", "aperture", "cat_eye", "fit", "fallback", "track_focus", "prefer",
             "fit_region"),
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
Given = dict[str, tuple[Option, str]]
"""By attribute: the row, and the word that follows it; empty where none does."""


def keys_of(row: Option) -> list[str]:
    """The keys that a row has in a shot file, today's first."""
    if not row.flags:
        return ["file"]
    return [flag.removeprefix("--") for flag in row.flags if flag.startswith("--")]


@cache
def rows_of(table: str, command: str = "render") -> dict[str, Option]:
    """The rows of a table's keys."""
    return {
        key: row
        for attribute in TABLES[table]
        for row in ROWS
        if row.attribute == attribute and command in row.commands
        for key in keys_of(row)
    }


def is_shot_file(word: str) -> bool:
    """Whether the first word of a command line names a shot file."""
    return word.endswith(".toml") and not word.startswith("-")


def words_of(
    path: Path, words: Sequence[str], command: str, *, own_output: bool = True
) -> list[str]:
    """The command line that a shot file and the words after it make.

    Args:
        path: the shot file.
        words: the file to write, where it is not the shot file's own; and options, which win over
            those of the shot file.
        command: `render`, `fit` or `farm`; options that it does not have are left out.
        own_output: whether the shot file's own result is written; never by `fit`.

    Raises:
        UsageError: the file cannot be read, or is no shot file.
    """
    return words_by(read_tables(path), path, words, command, own_output=own_output)


def words_by(
    tables: Tables,
    path: Path,
    words: Sequence[str] = (),
    command: str = "render",
    *,
    own_output: bool = True,
) -> list[str]:
    """As `words_of`, of tables that are, or will be, in a shot file.

    Args:
        tables: its content, without the version.
        path: the shot file, from whose folder files are named.
        words: as of `words_of`.
        command: as of `words_of`.
        own_output: as of `words_of`.

    Raises:
        UsageError: they are not those of a shot file.
    """
    plain, listed = apart(tables, path, rows_of)
    given = given_by(plain, path)
    named = _POSITIONALS if own_output and command != "fit" else _POSITIONALS[:2]
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
    options += [
        f"--{LISTED[attribute]}={word}" for attribute, word in listed if attribute not in again
    ]
    first = next((at for at, word in enumerate(words) if word.startswith("--")), len(words))
    return [*(given[one][1] for one in named), *words[:first], *options, *words[first:]]


def sets(attribute: str, words: Sequence[str]) -> bool:
    """Whether one of the words of a command line may set an attribute of the parsed arguments."""
    return any(attribute in _attributes(word) for word in words)


def _attributes(word: str) -> set[str]:
    """Attributes that a word of a command line may set: an option can be abbreviated."""
    name = word.partition("=")[0]
    if not name.startswith("--"):
        return set()
    whole = {row.attribute for row in ROWS if name in row.flags}
    begun = (row for row in ROWS if any(flag.startswith(name) for flag in row.flags))
    return whole or {row.attribute for row in begun}


def read_tables(path: Path) -> Tables:
    """The content of a shot file, without its version.

    Raises:
        UsageError: the file cannot be read, or is of another version.
    """
    tables = read_toml(path, f"{path}: cannot be read as a shot file")
    version = tables.pop("version", None)
    if isinstance(version, bool) or version not in (VERSION, LISTS):
        said = "says no version" if version is None else f"has version {version}"
        raise UsageError(
            f"{path}: {said}; a shot file begins with version = {VERSION}, or with "
            f"version = {LISTS} if it has [[object]]"
        )
    if is_listed(tables) and version != LISTS:
        raise UsageError(f"{path}: has [[object]]; then it begins with version = {LISTS}")
    return tables


def files_by(tables: Tables, path: Path) -> dict[str, Path]:
    """The files and folders that tables name, by the option's attribute; arguments as `words_by`.

    Raises:
        UsageError: they are not those of a shot file.
    """
    plain, _ = apart(tables, path, rows_of)
    places = {
        attribute: (row, place_of(row, word))
        for attribute, (row, word) in given_by(plain, path).items()
    }
    others = tables["object"][1:] if is_listed(tables) else []
    found = {f"object {number}": file_of(one, path) for number, one in enumerate(others, 2)}
    return found | {
        attribute: place
        for attribute, (row, place) in places.items()
        if place is not None and (place.suffix or row.type is None or exists(place)
                                  or row.files[0].role == "writes")
    }  # fmt: skip


def given_by(tables: Tables, path: Path) -> Given:
    """The row and the word of each key, by the option's attribute.

    Args:
        tables: as of `words_by`, with a single object.
        path: as of `words_by`.

    Raises:
        UsageError: they are not those of a shot file.
    """
    given: Given = {}
    for table, entries in tables.items():
        if table not in TABLES:
            raise UsageError(f"{path}: there is no table [{table}]; {meant(table, TABLES)}")
        if not isinstance(entries, dict):
            raise UsageError(f"{path}: {table} is no table; begin it with the line [{table}]")
        for key, value in entries.items():
            row = _row(path, table, key)
            word = word_of(value)
            if word is None:
                raise UsageError(
                    f"{path}: [{table}] {key}: expected a text, a number, true, false or a list of "
                    "numbers"
                )
            if "\0" in word:  # before the word becomes a path, which the system refuses
                raise UsageError(f"{path}: [{table}] {key}: has a NUL character; leave it out")
            if row.attribute in given:
                other = keys_of(given[row.attribute][0])[0]
                raise UsageError(f"{path}: [{table}] {key} and {other} exclude each other")
            if value is not False:
                given[row.attribute] = row, word
    device = "input_format" in given
    return {
        attribute: (row, _from_here(row, word, path.parent, device=device))
        for attribute, (row, word) in given.items()
    }


def _row(path: Path, table: str, key: str) -> Option:
    rows = rows_of(table)
    if key in rows:
        return rows[key]
    other = next((one for one in TABLES if key != "file" and key in rows_of(one)), None)
    if other is not None:
        raise UsageError(f"{path}: [{table}] {key}: belongs into [{other}]")
    raise UsageError(f"{path}: there is no {key} in [{table}]; {meant(key, rows)}")


def _from_here(row: Option, word: str, folder: Path, *, device: bool) -> str:
    """A word; where it names a file beside the shot file, with the way there."""
    place = place_of(row, word)
    if place is None:
        return word
    here = folder / place
    other = (device and row.attribute == "input") or (row.type is not None and not place.suffix)
    if row.files[0].role == "reads" and other and not exists(here):
        return word  # a device, or a value of another kind: `plate` is an environment
    return str(here)


def place_of(row: Option, word: str) -> Path | None:
    """The path that a word names, if any."""
    place = local_path(word) if row.files and word else None
    return None if place is None or row.files[0].is_word(place) else place
