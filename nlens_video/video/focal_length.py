"""Focal length from what a recording says of its camera."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from msgspec import Struct

from nlens_video.core.placement import FULL_FRAME_DIAGONAL_MM
from nlens_video.video.info import SourceInfo

_EQUIVALENT = (
    "focal_length.35mm_equivalent", "focallengthin35mmfilm", "focallengthin35mmformat",
)  # fmt: skip
"""Ends of the names of tags that hold a 35 mm equivalent: QuickTime's, EXIF's, ExifTool's."""
_LENS_NAME, _PHONE = (
    "camera.lenstype",
    re.compile(r"iphone.*\s(\d+(?:\.\d+)?)\s?mm$", re.IGNORECASE),
)
_PER_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # EXIF's FocalPlaneResolutionUnit
_SENSOR_MM = 2.0, 70.0  # long sides of sensors: others are errors of the tags
_SAME_SHAPE, _SAME_FOCAL = 0.02, 0.1
_VIDEO, _STILL, _CROPPED, _SENSOR = 0.08, 0.03, 0.15, 0.02
"""Relative errors: video is cropped by stabilisation and by the shape of the sensor; a photograph's
equivalent is rounded to a millimetre, and lenses differ from their names by some percent; it no
longer holds where the picture was cut to another shape."""


class TaggedFocal(Struct, frozen=True):
    """A focal length that a recording states.

    Attributes:
        equivalent_mm: 35 mm equivalent by the frame's diagonal [mm].
        error: relative standard error [1].
        tag: which tags say so.
    """

    equivalent_mm: float
    error: float
    tag: str


def tagged_focal(info: SourceInfo) -> TaggedFocal | None:
    """The focal length that a plate's metadata states, None without.

    A photograph's sensor, where its pitch is stated, is believed before the rounded equivalent,
    unless they contradict each other.
    """
    tags = info.camera_tags
    found = _equivalent(tags)
    if info.kind in ("video", "stream"):
        return None if found is None else TaggedFocal(found[1], _VIDEO, found[0])
    cropped = _is_cropped(tags, info)
    sensor = None if cropped else _by_sensor(tags, info)
    if found is None:
        return sensor
    if sensor is not None and abs(sensor.equivalent_mm / found[1] - 1.0) < _SAME_FOCAL:
        return sensor
    return TaggedFocal(found[1], _CROPPED if cropped else _STILL, found[0])


def _equivalent(tags: Mapping[str, str]) -> tuple[str, float] | None:
    """Name and value of the first tag with a 35 mm equivalent [mm]."""
    for key, value in tags.items():
        if key.lower().endswith(_EQUIVALENT):
            focal = leading_number(value)
        elif key.lower().endswith(_LENS_NAME) and (named := _PHONE.match(value.strip())):
            focal = float(named[1])
        else:
            continue
        if focal is not None and 1.0 <= focal <= 10_000.0:
            return key.rpartition("/")[2], focal
    return None


def _by_sensor(tags: Mapping[str, str], info: SourceInfo) -> TaggedFocal | None:
    """From the lens' own focal length and the pixels on the sensor."""
    focal, per_unit = _exif(tags, "FocalLength"), _exif(tags, "FocalPlaneXResolution")
    unit_mm = _PER_UNIT_MM.get(int(_exif(tags, "FocalPlaneResolutionUnit") or 2))
    if focal is None or per_unit is None or unit_mm is None or per_unit <= 0.0 or focal <= 0.0:
        return None
    long_px = float(max(info.stored_size))
    recorded_px = max(
        _exif(tags, "PixelXDimension") or long_px, _exif(tags, "PixelYDimension") or 0.0
    )
    long_mm = recorded_px * unit_mm / per_unit
    if not _SENSOR_MM[0] <= long_mm <= _SENSOR_MM[1]:
        return None
    diagonal_mm = long_mm * math.hypot(*info.stored_size) / long_px
    return TaggedFocal(
        focal * FULL_FRAME_DIAGONAL_MM / diagonal_mm, _SENSOR, "FocalLength, FocalPlaneXResolution"
    )


def _is_cropped(tags: Mapping[str, str], info: SourceInfo) -> bool:
    """Whether the picture has another shape than it was recorded in."""
    across, down = _exif(tags, "PixelXDimension"), _exif(tags, "PixelYDimension")
    if not across or not down:
        return False
    recorded = max(across, down) / min(across, down)
    stored = max(info.stored_size) / min(info.stored_size)
    return abs(recorded / stored - 1.0) > _SAME_SHAPE


def _exif(tags: Mapping[str, str], name: str) -> float | None:
    """A number of EXIF, which FFmpeg puts under `ExifIFD/`."""
    return leading_number(tags.get(f"ExifIFD/{name}", tags.get(name, "")))


def leading_number(text: str) -> float | None:
    """The number that a tag begins with: `26`, `26.00mm`, `21:5`, `21/5`; None for others."""
    match = re.match(r"\s*(\d+(?:\.\d*)?)(?:\s*[:/]\s*(\d+(?:\.\d*)?))?", text)
    if match is None:
        return None
    divisor = float(match[2] or 1.0)
    return float(match[1]) / divisor if divisor else None
