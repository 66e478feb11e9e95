"""What is known of the plate's lens beforehand, and what that says of the linear lens model.

A thin lens makes a CoC of A v |1/s - 1/d| on the sensor: A = f / N is the aperture, s the focused
distance, v the distance of the image, which the camera's own focal length in pixels measures. So
the slope of the model is A times that focal length, and the intercept the slope by -s.
"""

from __future__ import annotations

import math
import re
from typing import Any, Literal

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import UsageError

SENSORS_MM = {
    "full-frame": 36.0, "super35": 24.9, "aps-c": 23.6, "mft": 17.3, "1-inch": 13.2,
}  # fmt: skip
"""Longer sides of sensors."""

_ERROR = 0.03
"""Relative standard error of the marks on a lens: rounded f-numbers, scales of distance."""

_USUAL_APERTURE_M = 0.012
"""Root mean square aperture of a lens whose focal length is the width of the frame [m].

Sensors about 25 mm wide (deviation of the logarithm 0.35), f-numbers about 4 (0.7).
"""

_LEAST_DIOPTRES = 0.005  # standard error of the mark of infinity [1 / m]
_NUMBER = r"(\d+(?:\.\d*)?|\.\d+)"
_PARTS = (
    ("focal_mm", re.compile(rf"{_NUMBER}mm$")),
    ("f_number", re.compile(rf"[fFtT]/{_NUMBER}$")),
)
_DECIMAL_COMMA = re.compile(r"(?<![\d.])\d+,\d+")  # or a comma between parts: nobody can tell
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
_LENGTH = re.compile(rf"{_NUMBER}(m|cm|mm|ft)$")
_LIMITS = {
    "focal_mm": (0.5, 5000.0), "f_number": (0.3, 128.0), "focus_m": (0.001, 1e6),
    "sensor_mm": (0.5, 200.0), "sensor_long_mm": (0.5, 200.0),
}  # fmt: skip
_HELP = 'write such as "50mm f/2.8 focus 2.4m sensor full-frame", or any part of it'

Prefer = Literal["near", "far"]
"""Of two lenses that explain a plate: the one focused nearer than the object, or farther."""


class Expected(Struct, frozen=True):
    """A value and its standard error."""

    value: float
    error: float

    @classmethod
    def of(cls, value: float, relative_error: float, least_error: float = 0.0) -> Expected:
        """A value that a lens is marked with, or that a recording states."""
        return cls(value, max(relative_error * value, least_error))

    def times(self, factor: float) -> Expected:
        """In another unit."""
        return Expected(factor * self.value, factor * self.error)


class LensPrior(Struct, frozen=True, kw_only=True):
    """What is known of the lens model beforehand; None where nothing is.

    Attributes:
        slope: of the model [px * scene unit].
        focus: disparity in focus [1 / scene unit].
        intercept: signed CoC at infinity [px]; given only without the other two.
        prefer: which of two lenses to take where the plate leaves it open.
        usual_slope: root mean square slope of lenses with this field of view, None where the
            scene's unit is not known [px * scene unit].
        source: who knows it, in words.
    """

    slope: Expected | None = None
    focus: Expected | None = None
    intercept: Expected | None = None
    prefer: Prefer | None = None
    usual_slope: float | None = None
    source: str = "what is known of the lens"

    @property
    def numbers(self) -> tuple[Expected | None, Expected | None, Expected | None]:
        """Slope, focus and intercept."""
        return self.slope, self.focus, self.intercept

    @property
    def in_numbers(self) -> bool:
        """Whether any number is known."""
        return self.numbers != (None, None, None)

    @property
    def complete(self) -> bool:
        """Whether it is a lens by itself."""
        return self.slope is not None and self.focus is not None

    def equations(self, slope: float) -> list[tuple[float, float, float]]:
        """What is known as equations: factors of slope and intercept, and the right side.

        Each has unit error; that of the focus is taken at a slope > 0 [px * scene unit].
        """
        told = []
        if (one := self.slope) is not None:
            told.append((1.0 / one.error, 0.0, one.value / one.error))
        if (one := self.focus) is not None:
            told.append((one.value / (slope * one.error), 1.0 / (slope * one.error), 0.0))
        if (one := self.intercept) is not None:
            told.append((0.0, 1.0 / one.error, one.value / one.error))
        return told


NO_PRIOR = LensPrior()


class KnownLens(Struct, frozen=True, kw_only=True):
    """A lens as its owner or its recording knows it; None where a value is not known.

    Attributes:
        focal_mm: focal length [mm].
        f_number: focal length by the diameter of the aperture [1].
        focus_m: focused distance along the optical axis, infinity allowed [m].
        sensor_mm: width of the part of the sensor that the frame shows [mm].
        sensor_long_mm: longer side of a sensor that lies along the longer side of the frame [mm].
        prefer: which of two lenses to take where the plate leaves it open.
        aperture_error: relative standard error of its aperture [1].
        focus_error: relative standard error of the focused distance [1].
        source: who knows it, in words.
    """

    focal_mm: float | None = None
    f_number: float | None = None
    focus_m: float | None = None
    sensor_mm: float | None = None
    sensor_long_mm: float | None = None
    prefer: Prefer | None = None
    aperture_error: float = _ERROR
    focus_error: float = _ERROR
    source: str = "what is known of the lens"

    def completed_by(self, other: KnownLens) -> KnownLens:
        """This lens, and what only `other` knows, with its errors: the aperture, the focus."""
        lens = self
        focal_mm, f_number = lens.focal_mm or other.focal_mm, lens.f_number or other.f_number
        used = (lens.focal_mm, lens.f_number) != (focal_mm, f_number)
        if used and None not in (focal_mm, f_number):
            lens = replace(
                lens, f_number=f_number, focal_mm=focal_mm, source=other.source,
                aperture_error=other.aperture_error,
            )  # fmt: skip
        if lens.focus_m is None and other.focus_m is not None:
            lens = replace(
                lens, focus_m=other.focus_m, focus_error=other.focus_error, source=other.source
            )
        return lens

    def across(self, width: float, height: float) -> KnownLens:
        """This lens, with the width of the sensor's part that a frame shows.

        Args:
            width: of the frame as it is displayed, in any unit.
            height: of it, in the same unit.
        """
        if self.sensor_long_mm is None:
            return self
        width_mm = self.sensor_long_mm * min(1.0, width / height)
        return replace(self, sensor_mm=width_mm, sensor_long_mm=None)

    def prior(self, focal_px: float, width_px: int, unit_m: float | None) -> LensPrior:
        """What this lens says of the model.

        Args:
            focal_px: of the plate's camera, across the frame [px].
            width_px: of the frame [px].
            unit_m: the scene's unit, None where it is not known: then only what needs no unit is
                used [m].
        """
        usual_m = _USUAL_APERTURE_M * focal_px / width_px
        usual = None if unit_m is None else usual_m * focal_px / unit_m
        told = self._numbers(focal_px, width_px, unit_m)
        return replace(told, prefer=self.prefer, usual_slope=usual, source=self.source)

    def _numbers(self, focal_px: float, width_px: int, unit_m: float | None) -> LensPrior:
        aperture_m = self._aperture_m(focal_px / width_px)
        slope = (
            None if aperture_m is None else Expected.of(aperture_m * focal_px, self.aperture_error)
        )
        focus = (
            None
            if self.focus_m is None
            else Expected.of(1.0 / self.focus_m, self.focus_error, _LEAST_DIOPTRES)
        )
        if unit_m is not None:
            return LensPrior(
                slope=None if slope is None else slope.times(1.0 / unit_m),
                focus=None if focus is None else focus.times(unit_m),
            )
        if slope is None or focus is None:
            return NO_PRIOR
        error = math.hypot(slope.error * focus.value, slope.value * focus.error)
        return LensPrior(intercept=Expected(-slope.value * focus.value, error))

    @property
    def tells_aperture(self) -> bool:
        """Whether its parts tell the diameter of the aperture."""
        size = (self.focal_mm, self.sensor_mm, self.sensor_long_mm)
        return self.f_number is not None and any(one is not None for one in size)

    @property
    def is_whole(self) -> bool:
        """Whether it is a lens by itself: its aperture and what it is focused on."""
        return self.tells_aperture and self.focus_m is not None

    @property
    def fov_x_deg(self) -> float | None:
        """Field of view across the frame, None where it is not known [deg]."""
        if self.focal_mm is None or self.sensor_mm is None:
            return None
        return 2.0 * math.degrees(math.atan(0.5 * self.sensor_mm / self._image_mm(self.focal_mm)))

    def _image_mm(self, focal_mm: float) -> float:
        """Distance of the image behind the lens [mm]."""
        distance_mm = math.inf if self.focus_m is None else 1000.0 * self.focus_m
        return focal_mm / (1.0 - focal_mm / distance_mm)

    def _aperture_m(self, focal_by_width: float) -> float | None:
        """Diameter of the aperture, None where it is not known [m]."""
        focal_mm = self.focal_mm
        if focal_mm is None and self.sensor_mm is not None:
            image_mm = focal_by_width * self.sensor_mm
            focus_mm = math.inf if self.focus_m is None else 1000.0 * self.focus_m
            focal_mm = image_mm / (1.0 + image_mm / focus_mm)
        if focal_mm is None or self.f_number is None:
            return None
        return 1e-3 * focal_mm / self.f_number


UNKNOWN_LENS = KnownLens()


def parse_lens(text: str) -> KnownLens:
    """Read such as `50mm f/2.8 focus 2.4m sensor full-frame`, or any part of it.

    Raises:
        UsageError: a part that is none of these, that comes twice, or whose value makes no sense.
    """
    if comma := _DECIMAL_COMMA.search(text):
        point = comma[0].replace(",", ".")
        raise UsageError(
            f"--lens {text!r}: {comma[0]!r}: decimals have a point ({point}), and parts a space "
            f"between them; {_HELP}"
        )
    found: dict[str, Any] = {}
    words = text.replace(",", " ").lower().split()
    while words:
        word = words.pop(0)
        name, value = _named(word, words)
        low, high = _LIMITS[name]
        twice = any(name.partition("_")[0] == other.partition("_")[0] for other in found)
        if twice or not (low <= value <= high or (name == "focus_m" and value == math.inf)):
            fault = "comes twice" if twice else f"is not from {low:g} to {high:g}"
            raise UsageError(f"--lens {text!r}: {name.partition('_')[0]} {fault}; {_HELP}")
        found[name] = value
    lens = KnownLens(**found)
    if lens == UNKNOWN_LENS:
        raise UsageError(f"--lens {text!r}: no lens; {_HELP}")
    if lens.focal_mm and lens.focus_m and 1000.0 * lens.focus_m <= 1.001 * lens.focal_mm:
        raise UsageError(f"--lens {text!r}: focused nearer than its focal length; {_HELP}")
    return lens


def _named(word: str, after: list[str]) -> tuple[str, float]:
    """Name and value of a part; takes the word after `focus` and `sensor`."""
    for name, pattern in _PARTS:
        if match := pattern.match(word):
            return name, float(match[1])
    value = after.pop(0) if word in ("focus", "sensor") and after else ""
    if word == "focus":
        if value in ("inf", "infinity"):
            return "focus_m", math.inf
        if match := _LENGTH.match(value):
            return "focus_m", float(match[1]) * _METRES[match[2]]
    if word == "sensor":
        if value in SENSORS_MM:
            return "sensor_long_mm", SENSORS_MM[value]
        if match := re.match(rf"{_NUMBER}x{_NUMBER}(?:mm)?$", value):
            return "sensor_long_mm", max(float(match[1]), float(match[2]))
        if match := re.match(rf"{_NUMBER}(?:mm)?$", value):
            return "sensor_mm", float(match[1])
    said = f"{word} {value}".strip()
    names = f" (sensors: {', '.join(SENSORS_MM)}, or a width as 36mm)" if word == "sensor" else ""
    raise UsageError(f"--lens: {said!r} is no part of a lens{names}; {_HELP}")
