"""`jobs.toml`: many shots for one farm, each with the words of its own command line."""

from __future__ import annotations

import tomllib
from argparse import Namespace
from pathlib import Path

from nlens_video.cli.existing_outputs import settle_existing
from nlens_video.cli.path_guard import refuse_overwriting
from nlens_video.core.errors import OutputError, UsageError
from nlens_video.core.settings import Settings
from nlens_video.options import options as arguments
from nlens_video.options import to_settings

_NEEDED = ("in", "object", "out")
_FARMED = {"command": "farm", "jobs": None, "chunks": None}


def read_shot_list(path: Path, *, overwrite: bool = True) -> list[Settings]:
    """The runs that a file lists.

    Args:
        path: TOML with a `[[shot]]` for each: `in`, `object`, `out`, and `options`, a list of
            words as on the command line; paths as there, too.
        overwrite: whether what is there may be replaced without asking.

    Raises:
        UsageError: the file cannot be read, or a shot makes no sense.
        OutputError: a shot writes over what one of them reads, or must not replace what is there.
    """
    try:
        listed = tomllib.loads(path.read_text(encoding="utf-8")).get("shot")
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"--jobs {path}: cannot be read as TOML ({error})") from error
    if not isinstance(listed, list) or not listed:
        raise UsageError(f"--jobs {path}: lists no [[shot]] with in, object and out")
    shots = [_parsed(entry, f"--jobs {path}: shot {at}") for at, entry in enumerate(listed, 1)]
    runs = [run for _, run in shots]
    written = [run.output.spec for run in runs if run.output is not None]
    twice = next((name for name in written if written.count(name) > 1), None)
    if twice is not None:
        raise UsageError(f"--jobs {path}: two shots write {twice}; give each its own")
    try:
        farmed = [words for words, _ in shots]
        refuse_overwriting(Namespace(command="farm", jobs=path), *farmed)
        settle_existing(*farmed, overwrite=overwrite)
    except OutputError as error:
        raise OutputError(f"--jobs {path}: {error}") from error
    return runs


def _parsed(entry: object, where: str) -> tuple[Namespace, Settings]:
    """The words of a shot, as `farm` would be given them, and what they mean."""
    if not isinstance(entry, dict):
        raise UsageError(f"{where} is no table")
    unknown = set(entry) - {*_NEEDED, "options"}
    if unknown:
        raise UsageError(
            f"{where}: no {sorted(unknown)[0]!r} there; expected in, object, out, options"
        )
    named = [entry.get(key) for key in _NEEDED]
    options = entry.get("options", [])
    if not isinstance(options, list) or not all(isinstance(w, str) for w in (*named, *options)):
        raise UsageError(f"{where}: in, object and out must be texts, options a list of them")
    try:
        words = arguments.parse(["render", *map(str, named), *options])
        return Namespace(**{**vars(words), **_FARMED}), to_settings.settings(words)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error
