"""FFmpeg's muxers by the names of files, and what is known of them beside what trials show."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

import av

MP4_FAMILY = ("mp4", "mov", "ipod", "3gp", "3g2", "ismv", "f4v")
"""FFmpeg's muxers of ISO base media files."""
SOUND_ONLY = ("mp3", "flac")
"""These have a default codec for pictures, but for covers only."""
_RECENT = {
    "flv": ("hevc", "vp8", "vp9", "av1", "opus", "flac", "ac3", "eac3"),  # since 2023
    "mxf": ("ffv1",),
    "avi": ("flac",),  # read again, but not decoded
}


@dataclass(frozen=True, slots=True)
class Muxer:
    """What writes a container.

    Attributes:
        name: FFmpeg's.
        video_codec: FFmpeg's default for pictures; `none` where it holds none.
    """

    name: str
    video_codec: str


def muxer(spec: str) -> Muxer | None:
    """What writes files of such a name; None where nothing does. No file is made."""
    try:
        with av.open(f"file:{spec}", "w") as container:
            return Muxer(container.format.name, container.default_video_codec)
    except ValueError:
        return None


def is_recent(container: str, codec: str) -> bool:
    """Whether programs that are a few years old do not read a codec in a container.

    Such a codec is taken where it is asked for, not by itself.

    Args:
        container: FFmpeg's name of the muxer.
        codec: FFmpeg's name of a decoder or an encoder.
    """
    name = canonical(codec)
    return name in _RECENT.get(container, ()) or (container == "mp4" and name.startswith("pcm_"))


def canonical(codec: str) -> str:
    """FFmpeg's name of the codec that a decoder or an encoder, by its name, is of."""
    for mode in ("r", "w"):
        with contextlib.suppress(ValueError):
            return av.Codec(codec, mode).canonical_name
    return codec


def nothing_writes(spec: str) -> str:
    """What to say where no container belongs to a name."""
    return f"{spec}: nothing writes this extension; try .mp4, .mov, .mkv, .webm, .png"


def no_pictures(spec: str) -> str:
    """What to say where a container has no place for pictures."""
    kind = f"{Path(spec).suffix} files hold"
    return f"{spec}: {kind} no video; try .mp4, .mov, .mkv, .webm, .png"
