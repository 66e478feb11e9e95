"""Which lossless codec carries the samples of a chunk, all of them unchanged, and how quickly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import av

from nlens_video.core.errors import UsageError
from nlens_video.video.pixels.pixel_formats import layout

_QUICK, _GENERAL = "ffvhuff", "ffv1"
_SLICED = 64  # least side of a picture in slices [px]
_RGB_CARRIERS = {(8, False): "rgb24", (8, True): "bgra", (16, False): "rgb48le"}


@dataclass(frozen=True, slots=True)
class Carrier:
    """What carries samples unchanged.

    Attributes:
        codec: FFmpeg's name of a lossless encoder.
        pixel_format: FFmpeg's name of the format that it is given.
        options: of the encoder.
    """

    codec: str
    pixel_format: str
    options: dict[str, str]


def carrier(pixel_format: str, width: int, height: int) -> Carrier:
    """What carries all samples of a format unchanged.

    Args:
        pixel_format: a working format, FFmpeg's name.
        width: columns as stored [px].
        height: rows as stored [px].

    Raises:
        UsageError: nothing does.
    """
    kind = layout(pixel_format)
    if kind is not None and kind.family != "float":
        # full range is a tag, the samples are the same
        bare = f"yuv{pixel_format[4:]}" if pixel_format.startswith("yuvj") else pixel_format
        packed = _RGB_CARRIERS.get((kind.bits, kind.alpha)) if kind.family == "rgb" else None
        for name in filter(None, (bare, packed)):
            # chroma that does not fit is cut off by ffvhuff, without a word, or refused in slices
            fits = width % kind.step_x == 0 == height % kind.step_y
            if fits and name in _taken(_QUICK):
                return Carrier(_QUICK, name, {"pred": "plane"})
            if name in _taken(_GENERAL):
                slices = "4" if fits and min(width, height) >= _SLICED else "1"
                return Carrier(_GENERAL, name, {"level": "3", "g": "1", "slices": slices})
    raise no_carrier(pixel_format)


@cache
def _taken(codec: str) -> set[str]:
    """Pixel formats that an encoder takes."""
    return {one.name for one in av.Codec(codec, "w").video_formats or ()}


def no_carrier(kind: str) -> UsageError:
    """What to say where nothing carries a kind of plate."""
    return UsageError(
        f"a plate in {kind} has no lossless chunks; render ranges of it straight into a sequence "
        "such as out_%06d.exr, whose files keep their numbers"
    )
