"""What a recording says of its lens, in EXIF or in tags of its file: aperture and focus."""

from __future__ import annotations

import re
from collections.abc import Mapping

from nlens_video.core.known_lens import UNKNOWN_LENS, KnownLens
from nlens_video.video.focal_length import leading_number

_LENS_NAMES = ("lensmodel", "lens_model", "lens-model")
_LENS_NAME = re.compile(r"(?:^|\s)(\d+(?:\.\d+)?)\s?mm\s+f/(\d+(?:\.\d+)?)$", re.IGNORECASE)
"""Of a lens with one focal length and one f-number, as phones name theirs."""

_APERTURE_ERROR = 0.05
"""Relative: f-numbers are rounded to thirds of a stop, and close up a lens has less light."""
_FOCUS_ERROR = 0.2
"""Relative: lenses tell the distance in coarse steps."""
_INFINITELY_FAR_M = 1e6
_INFINITE = re.compile(r"\s*(-1|4294967295)\s*:")
"""EXIF writes infinity as 0xFFFFFFFF, which FFmpeg reads as a signed number."""
_UNITS = {"mm": 0.001, "cm": 0.01}  # that a text may name; EXIF counts metres


def tagged_lens(tags: Mapping[str, str]) -> KnownLens:
    """Focal length, f-number and focused distance as far as a recording states them.

    Args:
        tags: of the recording, as `SourceInfo.camera_tags`.
    """
    focal, number = _number(tags, "focallength"), _number(tags, "fnumber")
    if number is None and (apex := _number(tags, "aperturevalue")) is not None:
        number = 2.0 ** (0.5 * apex)
    if focal is None or number is None:
        named = _by_name(tags)
        focal, number = focal or named[0], number or named[1]
    distance = _distance_m(tags)
    if number is None and distance is None:
        return UNKNOWN_LENS
    return KnownLens(
        focal_mm=focal,
        f_number=number,
        focus_m=distance,
        aperture_error=_APERTURE_ERROR,
        focus_error=_FOCUS_ERROR,
        source="the lens of the metadata",
    )


def _distance_m(tags: Mapping[str, str]) -> float | None:
    """The focused distance, infinity allowed [m]."""
    for key, value in tags.items():
        if key.lower().rpartition("/")[2] == "subjectdistance":
            if _INFINITE.match(value):
                return float("inf")
            distance = leading_number(value)
            if distance is not None and distance > 0.0:
                distance *= _UNITS.get(value.strip().lower()[-2:], 1.0)
                return float("inf") if distance > _INFINITELY_FAR_M else distance
    return None


def _number(tags: Mapping[str, str], name: str) -> float | None:
    """A positive number of EXIF, which FFmpeg puts under `ExifIFD/`."""
    for key, value in tags.items():
        if key.lower().rpartition("/")[2] == name:
            number = leading_number(re.sub(r"^\s*[fF]/", "", value))
            if number is not None and number > 0.0:
                return number
    return None


def _by_name(tags: Mapping[str, str]) -> tuple[float | None, float | None]:
    """Focal length [mm] and f-number of a lens that is named by them."""
    for key, value in tags.items():
        if key.lower().endswith(_LENS_NAMES) and (named := _LENS_NAME.search(value.strip())):
            return float(named[1]), float(named[2])
    return None, None
