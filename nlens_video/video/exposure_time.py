"""The exposure time that a recording states, in EXIF or in tags of its file."""

from __future__ import annotations

from collections.abc import Mapping

from nlens_video.video.focal_length import leading_number

_NAMES = ("exposuretime", "exposure_time", "exposure-time", "exptime")
"""Ends of the names of tags, in small letters: EXIF's, ExifTool's, OpenEXR's."""

_LONGEST_S = 60.0


def exposure_time_s(tags: Mapping[str, str]) -> float | None:
    """How long the shutter was open [s], None where no tag says so.

    Args:
        tags: of the recording, as `SourceInfo.camera_tags`.
    """
    for name, value in tags.items():
        if name.lower().endswith(_NAMES):
            seconds = leading_number(value)
            if seconds is not None and 0.0 < seconds <= _LONGEST_S:
                return seconds
    return None
