"""Codecs that a container holds since lately only, and names of codecs."""

from __future__ import annotations

import contextlib

import av

_RECENT = {
    "flv": ("hevc", "vp8", "vp9", "av1", "opus", "flac", "ac3", "eac3"),  # since 2023
    "mxf": ("ffv1",),
    "avi": ("flac",),  # read again, but not decoded
}


def is_recent(container: str, codec: str) -> bool:
    """Whether programs that are a few years old cannot read a codec in a container.

    Such a codec is used only on request.

    Args:
        container: FFmpeg's name of the muxer.
        codec: FFmpeg's name of a decoder or an encoder.
    """
    name = canonical(codec)
    return name in _RECENT.get(container, ()) or (container == "mp4" and name.startswith("pcm_"))


def canonical(codec: str) -> str:
    """FFmpeg's name of the codec of a decoder or an encoder."""
    for mode in ("r", "w"):
        with contextlib.suppress(ValueError):
            return av.Codec(codec, mode).canonical_name
    return codec
