"""What is known of a part of a source: its chapters and its timecode."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import av.container

from nlens_video.video.info import SourceInfo

_TIMECODE = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d+)")


def part_of(info: SourceInfo, frames: tuple[int, int | None]) -> SourceInfo:
    """The source as it is seen by a result that holds some of its frames only.

    Args:
        info: the whole source.
        frames: first index and the one past the last, None for an open end.
    """
    first, end = frames
    if (first, end) == (0, None) or not info.average_rate:
        return info
    start_s = first / info.average_rate
    end_s = None if end is None else end / info.average_rate
    shifted = [_cut(chapter, start_s, end_s) for chapter in info.chapters]
    return replace(
        info,
        chapters=tuple(one for one in shifted if one is not None),
        metadata=_advanced(info.metadata, first, info.average_rate),
        stream_metadata=_advanced(info.stream_metadata, first, info.average_rate),
    )


def advanced_timecode(timecode: str, frames: int, rate: Fraction) -> str:
    """A SMPTE timecode some frames later; one that is none comes back as it is.

    Args:
        timecode: `HH:MM:SS:FF`; `;` or `.` before the frames means drop frame.
        frames: how many later [1].
        rate: frames per second [1/s].
    """
    match = _TIMECODE.fullmatch(timecode)
    if match is None:
        return timecode
    hours, minutes, seconds, number = (int(match[group]) for group in (1, 2, 3, 5))
    count = round(rate)
    dropped = count // 15 if match[4] in ";." else 0  # two of 30, four of 60
    all_minutes = hours * 60 + minutes
    at = (all_minutes * 60 + seconds) * count + number + frames
    at -= dropped * (all_minutes - all_minutes // 10)
    if dropped:
        tens, rest = divmod(at, 600 * count - 9 * dropped)
        at += 9 * dropped * tens
        at += dropped * max(0, (rest - dropped) // (60 * count - dropped))
    at %= 24 * 3600 * count
    seconds, number = divmod(at, count)
    clock = f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    return f"{clock}{match[4]}{number:02}"


def _advanced(tags: dict[str, str], frames: int, rate: Fraction) -> dict[str, str]:
    return {
        key: advanced_timecode(value, frames, rate) if key.lower() == "timecode" else value
        for key, value in tags.items()
    }


def _cut(
    chapter: av.container.Chapter, start_s: Fraction, end_s: Fraction | None
) -> av.container.Chapter | None:
    """A chapter in the part's own time, None where it lies outside."""
    unit = chapter["time_base"] or Fraction(1, 1000)
    shift, limit = round(start_s / unit), None if end_s is None else round(end_s / unit)
    start, end = max(chapter["start"], shift), chapter["end"]
    end = end if limit is None else min(end, limit)
    if end <= start:
        return None
    cut = chapter.copy()
    cut["start"], cut["end"] = start - shift, end - shift
    return cut
