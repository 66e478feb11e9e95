"""TOML that users write, and its values as words of a command line, and back."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from nlens_video.core.errors import UsageError

_LARGEST = 1 << 63
"""Beyond it no whole number of TOML is; one of thousands of digits cannot be printed either."""


def read_toml(path: Path, failure: str) -> dict[str, Any]:
    """The content of a file of TOML.

    Args:
        path: the file.
        failure: what the message begins with where it cannot be read.

    Raises:
        UsageError: it cannot be read, or is no TOML.
    """
    try:
        return parsed_toml(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(f"{failure} ({reason})") from error


def parsed_toml(text: str) -> dict[str, Any]:
    """The content of a text of TOML.

    Raises:
        ValueError: it is no TOML, or nested too deeply for Python's parser.
    """
    try:
        tables = tomllib.loads(text)
        _check_numbers(tables)
    except RecursionError:
        raise ValueError("its lists or tables are nested too deeply") from None
    return tables


def _check_numbers(value: object) -> None:
    if isinstance(value, int) and not -_LARGEST <= value < _LARGEST:
        raise ValueError("a whole number has more than 64 bits")
    if isinstance(value, list | dict):
        for one in value.values() if isinstance(value, dict) else value:
            _check_numbers(one)


def word_of(value: object) -> str | None:
    """A value as a word of a command line, empty for true and false; None: it cannot be one."""
    if isinstance(value, bool):
        return ""
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list):
        words = [repr(one) for one in value if is_number(one)]
        return ",".join(words) if words and len(words) == len(value) else None
    return value if isinstance(value, str) and value else None


def is_number(value: object) -> bool:
    """Whether a value of TOML is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def table_of(word: str) -> dict[str, Any]:
    """The table that a word holds in TOML's inline form, such as `{time = 2, yaw = 90}`.

    Raises:
        ValueError: it is none.
    """
    table = parsed_toml(f"value = {word}")["value"]
    if not isinstance(table, dict):
        raise ValueError("no table in braces")
    return table


def inline(value: object) -> str:
    """A value of TOML on one line; tables in braces.

    Raises:
        ValueError: a kind of value that no option has, such as a date.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if is_number(value):
        return repr(value)
    if isinstance(value, str):
        # TOML's basic strings are JSON's, but for one control character more
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return f"[{', '.join(map(inline, value))}]"
    if isinstance(value, Mapping):
        pairs = (f"{_key(str(key))} = {inline(one)}" for key, one in value.items())
        return f"{{{', '.join(pairs)}}}"
    raise ValueError(f"{value} is neither a text, a number, true, false, a list nor a table")


def _key(name: str) -> str:
    bare = name and all(one.isascii() and (one.isalnum() or one in "-_") for one in name)
    return name if bare else inline(name)


def meant(given: str, names: Iterable[str]) -> str:
    """What was probably meant by a name that is none of those that there are."""
    known = list(names)
    near = get_close_matches(given, known, n=1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
