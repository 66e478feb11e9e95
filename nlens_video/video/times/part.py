"""Properties of a part of a source."""

from __future__ import annotations

import re
from fractions import Fraction

import av.container
from msgspec.structs import replace

from nlens_video.video.info import CopiedStream, SourceInfo

_TIMECODE = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d+)")


def part_of(info: SourceInfo, frames: tuple[int, int | None]) -> SourceInfo:
    """Properties of a part of a source: its end; chapters and timecode are shifted.

    Args:
        info: the whole source.
        frames: first index and the one past the last, None for an open end.
    """
    first, end = frames
    if (first, end) == (0, None) or not info.average_rate:
        return info
    start_s = _time(info, first) if info.chapters else Fraction(0)
    end_s = _time(info, end) if info.chapters and end is not None else None
    shifted = [cut_chapter(chapter, start_s, end_s) for chapter in info.chapters]
    return replace(
        info,
        ends_s=_end(info, first, end)
        if any(one.type == "subtitle" for one in info.copied)
        else None,
        start_s=Fraction(0) if first else info.start_s,
        copied=_begun_later(info, first) if first else info.copied,
        chapters=tuple(one for one in shifted if one is not None),
        metadata=_advanced(info.metadata, info, first),
        stream_metadata=_advanced(info.stream_metadata, info, first),
    )


def _begun_later(info: SourceInfo, first: int) -> tuple[CopiedStream, ...]:
    """The other streams of a part, on its own clock."""
    late = any(one.start_s is not None and one.start_s > info.start_s for one in info.copied)
    begun_s = _time(info, first) if late else Fraction(0)
    waits_s = [
        Fraction(0) if one.start_s is None or not late else max(Fraction(0), one.start_s - begun_s)
        for one in info.copied
    ]
    return tuple(
        replace(one, start_s=wait_s, cut=not wait_s)
        for one, wait_s in zip(info.copied, waits_s, strict=True)
    )


def _end(info: SourceInfo, first: int, end: int | None) -> Fraction | None:
    """End of a part on its own clock, which begins with its first frame, or with the source [s]."""
    if end is None:
        return None
    if info.frame_time is not None:
        start_s = info.frame_time(first) if first else Fraction(0)
        end_s = info.frame_time(end)
        if start_s is not None and end_s is not None:
            return end_s - start_s
    # when the source's first frame is shown is not known
    known = bool(first and info.steady and info.average_rate)
    return (end - first) / (info.average_rate or Fraction(25)) if known else None


def _time(info: SourceInfo, number: int) -> Fraction:
    """Time of a frame [s], by the average rate where it is not known."""
    known = None if info.frame_time is None else info.frame_time(number)
    return number / (info.average_rate or Fraction(25)) if known is None else known


def advanced_timecode(timecode: str, frames: int, rate: Fraction) -> str:
    """A SMPTE timecode some frames later; other text is returned as it is.

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


def _advanced(tags: dict[str, str], info: SourceInfo, first: int) -> dict[str, str]:
    """Tags of a part; a timecode goes on by the time from the first frame on."""
    rate = info.average_rate
    if rate is None or "timecode" not in map(str.lower, tags):
        return tags
    frames = round((_time(info, first) - _time(info, 0)) * rate)
    return {
        key: advanced_timecode(value, frames, rate) if key.lower() == "timecode" else value
        for key, value in tags.items()
    }


def cut_chapter(
    chapter: av.container.Chapter, start_s: Fraction, end_s: Fraction | None
) -> av.container.Chapter | None:
    """A chapter in the time of a part, None where it lies outside.

    Args:
        chapter: of the whole source.
        start_s: of the part [s].
        end_s: of the part, None for an open end [s].
    """
    unit = chapter["time_base"] or Fraction(1, 1000)
    shift, limit = round(start_s / unit), None if end_s is None else round(end_s / unit)
    start, end = max(chapter["start"], shift), chapter["end"]
    end = end if limit is None else min(end, limit)
    if end <= start:
        return None
    cut = chapter.copy()
    cut["start"], cut["end"] = start - shift, end - shift
    return cut
