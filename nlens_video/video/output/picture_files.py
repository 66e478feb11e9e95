"""Kinds of picture files: their extensions, encoders, options and pixel formats."""

from __future__ import annotations

from functools import partial

from nlens_video.core.errors import OutputError
from nlens_video.video.info import SourceInfo
from nlens_video.video.output.containers import read_tags
from nlens_video.video.output.encoders import nearest_format
from nlens_video.video.output.encoding import Encoding, choose_encoding
from nlens_video.video.pixels.pixel_formats import layout, working_format
from nlens_video.video.stored_colour import stored_colour

EXTENSIONS = {
    ".bmp": "bmp", ".dpx": "dpx", ".exr": "exr", ".j2k": "jpeg2000", ".jls": "jpegls",
    ".jp2": "jpeg2000", ".jpeg": "mjpeg", ".jpg": "mjpeg", ".pam": "pam", ".pcx": "pcx",
    ".pgm": "pgm", ".png": "png", ".ppm": "ppm", ".qoi": "qoi", ".ras": "sunrast", ".sgi": "sgi",
    ".sun": "sunrast", ".tga": "targa", ".tif": "tiff", ".tiff": "tiff", ".webp": "libwebp",
    ".xwd": "xwd",
}  # fmt: skip
"""FFmpeg's encoders of the kinds that keep the picture, by extension."""
ANIMATED = (".webp",)
"""Those of them that hold videos as well."""
READ_AS_BT601 = ("libwebp", "mjpeg", "tiff")
"""Encoders whose YUV readers take for BT.601: their files say no matrix."""
_NOT_NUMBERED = (".avif", ".fits", ".ico")
"""Pictures that muxers of their own write, one file a run."""
_OPTIONS = {
    "mjpeg": {"flags": "+qscale", "global_quality": str(2 * 118)},
    "libwebp": {"lossless": "1"},
}
_ASPECT = ("dpx", "mjpeg", "pcx", "png", "tiff")
"""Encoders whose files say the shape of their pixels."""
_UNKNOWN = 2
"""FFmpeg's number of primaries that are not said."""
_JPEG2000 = ("rgb24", "rgb48le", "rgba", "rgba64le", "gray", "gray16le", "ya8", "ya16le")
"""Its formats that other readers show right: they take YUV for full range."""


def check_kind(spec: str, muxer: str, *, numbered: bool) -> None:
    """Refuse pictures of a kind that nothing here writes.

    Args:
        spec: the result, as the user gave it.
        muxer: FFmpeg's name of the one that its extension chooses.
        numbered: whether it names a sequence.

    Raises:
        OutputError: they would become video in a file that is named like a picture.
    """
    single = numbered and spec.lower().endswith(_NOT_NUMBERED)
    if muxer == "image2" or single:
        raise OutputError(
            f"{spec}: pictures are written as files that end in {', '.join(EXTENSIONS)}; "
            "give one of these, or a video"
        )


def picture_encoding(info: SourceInfo, suffix: str, pix_fmt: str | None) -> Encoding:
    """The encoder of a kind of picture, and the pixel format that keeps most of the source's.

    Args:
        info: the source.
        suffix: extension of the kind, one of `EXTENSIONS`.
        pix_fmt: the user's pixel format.

    Raises:
        OutputError: the kind holds grey pictures only, the source has colour.
        UsageError: the kind does not hold the pixel format.
    """
    codec = EXTENSIONS[suffix]
    goal = layout(working_format(info.pixel_format))
    if codec == "pgm" and goal is not None and goal.family != "gray":
        raise OutputError(f"{suffix}: holds grey pictures only, the plate has colour; give .ppm")
    if codec == "jpeg2000" and pix_fmt is None:
        pix_fmt = nearest_format(working_format(info.pixel_format), list(_JPEG2000), codec)
    return choose_encoding(
        info, lambda name, _: name == codec, suffix, codec=codec, pix_fmt=pix_fmt
    )


def lost_aspect(info: SourceInfo, suffix: str) -> tuple[str, ...]:
    """A note where pictures do not say that their pixels are not square.

    Args:
        info: the source.
        suffix: extension of the kind, one of `EXTENSIONS`.
    """
    ratio = info.uneven_aspect
    if ratio is None or EXTENSIONS[suffix] in _ASPECT:
        return ()
    shape = f"{ratio.numerator}:{ratio.denominator}"
    return (f"pixels of {shape} become square: {suffix} has no place for their shape",)


def lost_colour(info: SourceInfo, suffix: str, pixel_format: str) -> tuple[str, ...]:
    """A note where pictures do not say the source's transfer function, primaries or profile.

    Args:
        info: the source.
        suffix: extension of the kind, one of `EXTENSIONS`.
        pixel_format: of the encoder's input.
    """
    codec = EXTENSIONS[suffix]
    if info.icc_profile and codec == "mjpeg":
        return ()
    if info.icc_profile and info.frame_tags.color_primaries == _UNKNOWN:
        if codec != "png" or not info.orientation.upright:
            return (f"the ICC profile is left out: {suffix} does not hold it here; .jpg files do",)
        return ()
    read = partial(read_tags, "image2pipe", codec, pixel_format)
    lost = stored_colour(info, whole_format(pixel_format), read).lost
    if not lost:
        return ()
    tags = ", ".join(lost)
    return (f"colour tags are left out ({tags}): {suffix} does not hold them; .png files do",)


def whole_format(pixel_format: str) -> str:
    """A format without a matrix or subsampling that holds the samples of another one."""
    kind = layout(working_format(pixel_format))
    if kind is not None and kind.family == "yuv":
        names = ("rgba", "rgba64le") if kind.alpha else ("rgb24", "rgb48le")
        return names[kind.bits != 8]
    return working_format(pixel_format)


def picture_options(codec: str, pixel_format: str) -> dict[str, str]:
    """Options of an encoder of pictures: lossless where it can be.

    Args:
        codec: FFmpeg's name of the encoder.
        pixel_format: its input format.
    """
    kind = layout(working_format(pixel_format))
    # FFmpeg's lossless wavelet overflows where colours of 16 bits jump from end to end
    if codec == "jpeg2000" and kind is not None and (kind.bits == 8 or kind.family == "gray"):
        return {"pred": "1"}
    return dict(_OPTIONS.get(codec, {}))
