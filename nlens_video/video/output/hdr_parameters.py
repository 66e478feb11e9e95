"""HDR metadata as parameters of encoders, which do not take it from frames."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.hdr_metadata import HdrMetadata, MasteringDisplay


class _Words(NamedTuple):
    """How an encoder is told.

    Attributes:
        option: FFmpeg's name of the option that holds the encoder's own parameters.
        mastering: parameter of the mastering display.
        light: parameter of the light levels.
        chroma: text of a CIE coordinate.
        nits: text of a luminance [cd/m²].
    """

    option: str
    mastering: str
    light: str
    chroma: Callable[[Fraction], str]
    nits: Callable[[Fraction], str]


def _steps(unit: int) -> Callable[[Fraction], str]:
    """Whole steps of which a unit has so many."""
    return lambda value: str(round(value * unit))


def _decimal(value: Fraction) -> str:
    return f"{float(value):.8f}"


_SEI = (_steps(50000), _steps(10000))
"""Steps of H.264's and HEVC's messages."""
_ENCODERS = {
    "libx264": _Words("x264-params", "mastering-display", "cll", *_SEI),
    "libx265": _Words("x265-params", "master-display", "max-cll", *_SEI),
    "libsvtav1": _Words("svtav1-params", "mastering-display", "content-light", _decimal, _decimal),
}
_BY_FRAMES = ("apng", "png")
"""Encoders that take it from the frames themselves."""


def with_hdr(
    options: dict[str, str], encoder: str, metadata: HdrMetadata
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Options of an encoder with a source's HDR metadata, and notes on what is not carried over.

    Args:
        options: of the encoder.
        encoder: FFmpeg's name of it.
        metadata: of the source.
    """
    words = _ENCODERS.get(encoder)
    static = metadata.mastering is not None or metadata.light is not None
    untold = static and words is None and encoder not in _BY_FRAMES
    lost = ["HDR mastering"] if metadata.partial or untold else []
    notes = tuple(
        Note(f"{name} metadata is not carried over", NoteKind.STREAM_LEFT_OUT)
        for name in (*lost, *metadata.dynamic)
    )
    if words is None or not static:
        return options, notes
    told = [options[words.option]] if words.option in options else []
    if metadata.mastering is not None:
        told.append(f"{words.mastering}={_display(metadata.mastering, words)}")
    if metadata.light is not None:
        told.append("{}={},{}".format(words.light, *metadata.light))
    return {**options, words.option: ":".join(told)}, notes


def _display(mastering: MasteringDisplay, words: _Words) -> str:
    def pair(values: tuple[Fraction, Fraction], text: Callable[[Fraction], str]) -> str:
        return f"({text(values[0])},{text(values[1])})"

    colours = {"G": mastering.green, "B": mastering.blue, "R": mastering.red, "WP": mastering.white}
    chroma = "".join(name + pair(values, words.chroma) for name, values in colours.items())
    least, most = mastering.luminance
    return f"{chroma}L{pair((most, least), words.nits)}"
