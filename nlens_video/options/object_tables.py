"""One object beside the first, and one key of a path, as tables: `--object`, `--key`, `[[object]]`.

A value of a key is what the option of that name takes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any, TypeVar, cast

from nlens_video.core.errors import UsageError
from nlens_video.core.objects import FurtherObject, Interpolation, PlaceKey, PlaceKeys, Playback
from nlens_video.core.placement import GroundPlacing
from nlens_video.options import readers as read
from nlens_video.options.toml_words import meant, table_of, word_of

Read = TypeVar("Read")
INTERPOLATIONS = ("smooth", "linear")


def _interpolation(text: str) -> str:
    if text not in INTERPOLATIONS:
        raise argparse.ArgumentTypeError(f"{text!r} is not one of {', '.join(INTERPOLATIONS)}")
    return text


_PLACE: dict[str, Callable[[str], Any]] = {
    "at": read.point, "size": read.number, "height": read.length, "yaw": read.number,
}  # fmt: skip
_KEY = {"time": read.number, "frame": read.frame_index, **_PLACE}
OBJECT: dict[str, Callable[[str], Any]] = {
    "file": read.path, "scene": read.word, "animation": read.word, "loop": lambda text: True,
    "animation-speed": read.positive, "animation-offset": read.number, "ground-y": read.number,
    "at-frame": read.frame_index, "interpolation": _interpolation, **_PLACE,
}  # fmt: skip
"""Keys of an object beside the first one, but for `key`, and the readers of their values."""


def place_key(table: Mapping[str, Any]) -> PlaceKey:
    """A key from `{time = 2, at = [0.7, 0.8]}`.

    Raises:
        UsageError: it says nothing, or what makes no sense.
    """
    given = _read(table, _KEY)
    return PlaceKey(
        time_s=given.get("time"), frame=given.get("frame"), at=given.get("at"),
        size=given.get("size"), height_m=given.get("height"), yaw_deg=given.get("yaw"),
    )  # fmt: skip


def further_object(table: Mapping[str, Any]) -> FurtherObject:
    """An object from `{file = "b.glb", at = [0.6, 0.8], size = 0.2}`, perhaps with keys.

    Raises:
        UsageError: it says nothing, or what makes no sense.
    """
    given = _read({name: one for name, one in table.items() if name != "key"}, OBJECT)
    if "file" not in given:
        raise UsageError('an object needs its file = "…"')
    keys = place_keys(table.get("key", []), given.get("interpolation", "smooth"))
    keys.check_beside([name for name in _PLACE if name in given])
    playback = {"animation": "animation", "loop": "loop", "animation-speed": "speed",
                "animation-offset": "offset_s"}  # fmt: skip
    placed = any(name in given for name in _PLACE) or bool(keys)
    placing = GroundPlacing(
        at=given.get("at"), size=given.get("size"), height_m=given.get("height"),
        yaw_deg=given.get("yaw", 0.0),
    )  # fmt: skip
    return FurtherObject(
        glb=given["file"],
        scene=given.get("scene"),
        playback=Playback(**{to: given[name] for name, to in playback.items() if name in given}),
        ground_y=given.get("ground-y"),
        placing=placing if placed else None,
        at_frame=given.get("at-frame", 0),
        keys=keys,
    )


def place_keys(tables: object, interpolation: str) -> PlaceKeys:
    """The keys of one object, from its list of tables.

    Raises:
        UsageError: as `place_key`.
    """
    if not isinstance(tables, list) or not all(isinstance(one, dict) for one in tables):
        raise UsageError("key is no list of tables; give each key as [[object.key]]")
    keys = tuple(place_key(table) for table in tables)
    return PlaceKeys(keys=keys, interpolation=cast("Interpolation", interpolation))


def key_word(text: str) -> PlaceKey:
    """Reader of `--key`."""
    return _from_word(text, place_key, "{time = 2, at = [0.7, 0.8]}")


def object_word(text: str) -> FurtherObject:
    """Reader of `--object`."""
    return _from_word(text, further_object, '{file = "b.glb", at = [0.7, 0.8], size = 0.2}')


def _from_word(text: str, reader: Callable[[Mapping[str, Any]], Read], such: str) -> Read:
    try:
        return reader(table_of(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is no table, such as {such}") from None
    except UsageError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _read(table: Mapping[str, Any], readers: Mapping[str, Callable[[str], Any]]) -> dict[str, Any]:
    """The values of a table; those that are false are left out.

    Raises:
        UsageError: a name or a value is none of those that can be.
    """
    given = {}
    for name, value in table.items():
        if name not in readers:
            raise UsageError(f"there is no {name} here; {meant(name, readers)}")
        word = word_of(value)
        if word is None or (name == "loop") != isinstance(value, bool):
            raise UsageError(f"{name}: expected {_expected(name)}")
        try:
            if value is not False:
                given[name] = readers[name](word)
        except argparse.ArgumentTypeError as error:
            raise UsageError(f"{name}: {error}") from None
    return given


def _expected(name: str) -> str:
    if name == "loop":
        return "true or false"
    return "a text, a number or a list of numbers"
