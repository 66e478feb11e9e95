"""Checked access to a glTF file's JSON: a wrong type or range is one clear line."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TypeGuard, TypeVar

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.errors import SceneError

LARGEST = 1e18
"""Of coordinates, scales and brightness: the product of two is still a float32."""
_T = TypeVar("_T", bound=int | str)
_Float = TypeVar("_Float", np.float32, np.float64)


class Fields(Struct, frozen=True):
    """One JSON object of the file and where it stands.

    Attributes:
        data: the object's members.
        place: its path in the file, such as `nodes[3]`, for messages.
    """

    data: Mapping[str, object]
    place: str

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def wrong(self, key: str, expected: str) -> SceneError:
        """The error for a member that is not what it must be."""
        value = repr(self.data.get(key))
        came = value if len(value) <= 60 else value[:57] + "..."
        where = f"{self.place}.{key}" if self.place else key
        return SceneError(f"{where} is {came}, expected {expected}; export the file again")

    def integer(self, key: str, *, below: int | None = None, default: int | None = None) -> int:
        """An integer >= 0 (and `< below`); `default` where it is absent.

        Raises:
            SceneError: absent without a default, no integer, or out of range.
        """
        value = self.data.get(key, default)
        # Some exporters write 5.0 for 5, which JSON does not distinguish.
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise self.wrong(key, "an integer of 0 or more")
        if below is not None and value >= below:
            raise self.wrong(key, f"an index below {below}")
        return value

    def reference(self, key: str, count: int) -> int | None:
        """An index into a list of `count` entries, or None where it is absent."""
        return self.integer(key, below=count) if key in self.data else None

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number; `default` where it is absent.

        Raises:
            SceneError: absent without a default, no number, or not finite.
        """
        value = self.data.get(key, default)
        if not _is_finite(value):
            raise self.wrong(key, "a finite number")
        return float(value)

    def not_negative(self, key: str, default: float) -> float:
        """A number from 0 to `LARGEST`; `default` where it is absent.

        Raises:
            SceneError: another number, or none.
        """
        value = self.number(key, default)
        if not 0.0 <= value <= LARGEST:
            raise self.wrong(key, f"a number from 0 to {LARGEST:g}")
        return value

    def positive(self, key: str) -> float | None:
        """A number above 0, or None where it is absent."""
        value = self.number(key) if key in self.data else None
        if value is not None and value <= 0.0:
            raise self.wrong(key, "a number above 0")
        return value

    def choice(self, key: str, allowed: Collection[_T], default: _T | None = None) -> _T:
        """One of the allowed values; `default` where it is absent."""
        value = self.data.get(key, default)
        for one in allowed:
            if value == one:
                return one
        raise self.wrong(key, f"one of {', '.join(map(str, allowed))}")

    def vector(self, key: str, size: int, default: tuple[float, ...]) -> tuple[float, ...]:
        """`size` finite numbers; `default` where they are absent."""
        if key not in self.data:
            return default
        value = self.data[key]
        if not isinstance(value, list) or len(value) != size or not all(map(_is_finite, value)):
            raise self.wrong(key, f"{size} finite numbers")
        return tuple(map(float, value))

    def color(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Three finite numbers, none below 0; `default` where they are absent.

        Raises:
            SceneError: others, or none.
        """
        value = self.vector(key, 3, default)
        if min(value) < 0.0:
            raise self.wrong(key, "3 numbers that are not below 0")
        return value

    def integers(self, key: str, below: int) -> tuple[int, ...]:
        """A list of indices below `below`; empty where it is absent."""
        indices = self.numbers(key)
        if not all(0 <= index < below and index.is_integer() for index in indices):
            raise self.wrong(key, f"a list of indices below {below}")
        return tuple(int(index) for index in indices)

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers of any length; empty where it is absent."""
        value = self.data.get(key, [])
        return self.vector(key, len(value) if isinstance(value, list) else 0, ())

    def text(self, key: str, default: str = "") -> str:
        """A string; `default` where it is absent."""
        value = self.data.get(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, "a string")
        return value

    @property
    def name(self) -> str:
        """Its name, possibly empty; control characters, which would break a line, as blanks."""
        return "".join(c if c.isprintable() else " " for c in self.text("name"))

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of strings; empty where it is absent."""
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.wrong(key, "a list of strings")
        return tuple(value)

    def flag(self, key: str) -> bool:
        """A boolean; False where it is absent."""
        value = self.data.get(key, False)
        if not isinstance(value, bool):
            raise self.wrong(key, "true or false")
        return value

    def child(self, key: str) -> Fields:
        """A member object; an empty one where it is absent."""
        value = self.data.get(key, {})
        if not isinstance(value, dict):
            raise self.wrong(key, "an object")
        return Fields(value, f"{self.place}.{key}" if self.place else key)

    def children(self, key: str) -> tuple[Fields, ...]:
        """A list of objects; empty where it is absent."""
        value = self.data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.wrong(key, "a list of objects")
        prefix = f"{self.place}.{key}" if self.place else key
        return tuple(Fields(item, f"{prefix}[{index}]") for index, item in enumerate(value))

    def extension(self, name: str) -> Fields | None:
        """The extension's object, or None where it is not used here."""
        extensions = self.child("extensions")
        return extensions.child(name) if name in extensions else None


def check_range(values: npt.NDArray[_Float], what: str) -> npt.NDArray[_Float]:
    """The values, whose products are finite numbers as well.

    Raises:
        SceneError: one of them is not a number or beyond `LARGEST`.
    """
    if values.size and not max(values.max(), -values.min()) <= LARGEST:
        raise SceneError(f"{what} lies beyond {LARGEST:g}; export the scene in metres")
    return values


def _is_finite(value: object) -> TypeGuard[float]:
    """Whether a value is a number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the range of a float
        return False
