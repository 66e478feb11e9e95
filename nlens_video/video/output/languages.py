"""Languages of streams, in the codes that a container has for them.

ISO 639-2 has two codes for twenty languages, such as `deu` and `ger`. QuickTime files number a
choice of languages, and FFmpeg names each number by one code of its own.
"""

from __future__ import annotations

from functools import cache

import av
import av.container

from nlens_video.video.output.containers import holds_audio, read_language

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
