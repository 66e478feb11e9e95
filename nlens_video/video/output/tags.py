"""What a result says of itself and of its streams, as far as its container has a place for it.

Languages are given in the codes that a container has for them. ISO 639-2 has two codes for twenty
languages, such as `deu` and `ger`. QuickTime files number a choice of languages, and FFmpeg names
each number by one code of its own.
"""

from __future__ import annotations

from functools import cache

import av
import av.container
from av.stream import Disposition
from av.video.stream import VideoStream

from nlens_video.video.info import SourceInfo
from nlens_video.video.output.containers import (
    MP4_FAMILY,
    holds_audio,
    holds_title_and_chapters,
    read_language,
)

_SKIPPED_METADATA = ("major_brand", "minor_version", "compatible_brands", "encoder")
_OF_THE_OLD_PICTURES = (
    "encoder", "duration", "bps", "number_of_", "_statistics_", "rotate", "alpha_mode",
)  # fmt: skip
"""Prefixes of tags that do not hold for newly encoded pictures."""
_TIMECODE = ("mov", "mp4", "mxf", "matroska", "webm", "nut", "dv", "gxf")
"""Containers that store the timecode of the first frame."""
_ROTATION = (*MP4_FAMILY, "matroska", "webm")
"""Containers that store by how much pictures are turned when they are shown."""
_PAIRS = (
    "bod tib", "ces cze", "cym wel", "deu ger", "ell gre", "eus baq", "fas per", "fra fre",
    "hye arm", "isl ice", "kat geo", "mkd mac", "mri mao", "msa may", "mya bur", "nld dut",
    "ron rum", "slk slo", "sqi alb", "zho chi",
)  # fmt: skip
_TWINS = {code: twin for one in map(str.split, _PAIRS) for code, twin in (one, one[::-1])}
"""The other ISO 639-2 code of a language that has two."""
_QUICKTIME = {"swe": "sve", "hrv": "hr ", "srp": "sr ", "fao": "fo ", "pan": "pa ", "gle": "iri"}
"""FFmpeg's names of QuickTime's numbers that are no codes of ISO 639-2."""
_ISO = {name: code for code, name in _QUICKTIME.items()}
_UNKNOWN = ("", "und")
_SOUND = ("aac", "pcm_s16le", "mp2", "flac", "libopus")
"""Encoders of a trial."""


def set_file_tags(container: av.container.OutputContainer, info: SourceInfo) -> tuple[str, ...]:
    """Copy metadata and chapters of a file.

    Returns:
        Notes on a title, chapters and a timecode for which a result has no place.
    """
    name = container.format.name
    for key, value in info.metadata.items():
        if key not in _SKIPPED_METADATA:
            container.metadata[key] = value
    if info.chapters:
        container.set_chapters(list(info.chapters))
    titled = bool(info.metadata.get("title"))
    title, chapters = True, True
    if titled or info.chapters:
        title, chapters = holds_title_and_chapters(name)
    places = (
        ("the title is left out", "it", titled and not title),
        ("chapters are left out", "them", bool(info.chapters) and not chapters),
        ("the timecode is left out", "it", _has_timecode(info) and name not in _TIMECODE),
    )
    return tuple(f"{what}: {name} has no place for {it}" for what, it, lost in places if lost)


def set_languages(container: av.container.OutputContainer) -> tuple[str, ...]:
    """Give each stream of a result the code of its language that is read back.

    Returns:
        A note where the container has none.
    """
    lost = set()
    for stream in container.streams:
        language = stream.metadata.get("language", "")
        if language in _UNKNOWN:
            continue
        if code := held_language(container.format.name, language):
            stream.metadata["language"] = code
        else:
            lost.add(language)
    if not lost:
        return ()
    codes = ", ".join(sorted(lost))
    return (f"languages of streams are left out: {container.format.name} has no code for {codes}",)


@cache
def held_language(container: str, language: str) -> str:
    """The code by which a container holds a language; empty where it does not.

    Args:
        container: FFmpeg's name of the muxer.
        language: as a source has it.
    """
    encoder = _encoder(container)
    known = _ISO.get(language, language)
    same = tuple(one for one in (known, _TWINS.get(known), _QUICKTIME.get(known)) if one)
    if not encoder:
        return known  # nothing tells
    return next((one for one in same if read_language(container, encoder, one) in same), "")


@cache
def _encoder(container: str) -> str:
    """One whose sound a container holds, for a trial; empty without one or without a file."""
    if av.ContainerFormat(container, "w").no_file:
        return ""
    there = [one for one in _SOUND if one in av.codecs_available]
    return next((one for one in there if holds_audio(container, one)), "")


def holds_rotation(container: str) -> bool:
    """Whether a container says that its pictures are to be turned.

    Args:
        container: FFmpeg's name of the muxer.
    """
    return container in _ROTATION


def _has_timecode(info: SourceInfo) -> bool:
    return "timecode" in map(str.lower, (*info.stream_metadata, *info.metadata))


def set_tags(stream: VideoStream, info: SourceInfo) -> None:
    """Copy the video stream's tags and dispositions."""
    for key, value in info.stream_metadata.items():
        if not key.lower().startswith(_OF_THE_OLD_PICTURES):
            stream.metadata[key] = value
    if stream.pix_fmt == "yuva420p" and stream.name in ("libvpx", "libvpx-vp9"):
        stream.metadata["alpha_mode"] = "1"
    stream.disposition = Disposition(info.disposition)


def sample_entry(container: str, codec: str) -> str:
    """Sample entry (codec tag) that replaces FFmpeg's default; empty for the default.

    Apple's players require `hvc1` for HEVC: all parameter sets are in the header, as here.
    """
    return "hvc1" if container in MP4_FAMILY and codec == "libx265" else ""
