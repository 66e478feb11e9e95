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
_INFINITELY_FAR = 1e6  # EXIF writes infinity as 0xFFFFFFFF [m]


def tagged_lens(tags: Mapping[str, str]) -> KnownLens:
    """Focal length, f-number and focused distance as far as a recording states them.

    Args:
        tags: of the recording, as `SourceInfo.camera_tags`.
    """
    focal, number = _number(tags, "focallength"), _number(tags, "fnumber")
    if number is None and (apex := _number(tags, "aperturevalue")) is not None:
        number = 2.0 ** (0.5 * apex)
    if focal is None or number is None:
        focal, number = _by_name(tags)
    distance = _number(tags, "subjectdistance")
    if distance is not None and distance > _INFINITELY_FAR:
        distance = float("inf")
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


def _number(tags: Mapping[str, str], name: str) -> float | None:
    """A positive number of EXIF, which FFmpeg puts under `ExifIFD/`."""
    for key, value in tags.items():
        if key.lower().rpartition("/")[2] == name:
            number = leading_number(value)
            if number is not None and number > 0.0:
                return number
    return None


def _by_name(tags: Mapping[str, str]) -> tuple[float | None, float | None]:
    """Focal length [mm] and f-number of a lens that is named by them."""
    for key, value in tags.items():
        if key.lower().endswith(_LENS_NAMES) and (named := _LENS_NAME.search(value.strip())):
            return float(named[1]), float(named[2])
    return None, None
