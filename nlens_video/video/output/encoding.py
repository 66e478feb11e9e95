"""Choice of a result's encoder, pixel format, options and clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction

import av
from av.video.codeccontext import VideoCodecContext
from msgspec import Struct

from nlens_video.core.errors import OutputError, UsageError
from nlens_video.video.info import SourceInfo
from nlens_video.video.output.containers import MP4_FAMILY
from nlens_video.video.output.encoder_threads import ordinary_priority
from nlens_video.video.output.encoders import (  # fmt: skip
    check_pixel_format,
    clipped_light,
    encoder_called,
    encoder_of,
    encoder_options,
    nearest_format,
    not_held,
    shown_formats,
    some_format,
    unmarked_fields,
    what_is_lost,
    without_loss,
)
from nlens_video.video.output.hdr_parameters import with_hdr
from nlens_video.video.output.recent_codecs import canonical, is_recent
from nlens_video.video.pixels.pixel_formats import layout, working_format
from nlens_video.video.times.encoder_clocks import (
    CountingClock,
    EncoderClock,
    FixedRateClock,
    GridClock,
)
from nlens_video.video.times.start import counts_pictures

_SAME = (
    "ffv1", "ffvhuff", "huffyuv", "utvideo", "magicyuv", "mjpeg", "mpeg2video", "mpeg1video",
    "mpeg4", "dnxhd", "cfhd", "v210", "rawvideo", "qtrle", "png", "apng", "gif", "jpeg2000",
    "dvvideo", "h263", "flv", "wmv1", "wmv2", "msmpeg4v2", "msmpeg4",
)  # fmt: skip
_LOSSLESS = ("ffvhuff", "huffyuv", "utvideo", "magicyuv", "v210", "qtrle", "png", "apng")
"""Lossless codecs that FFV1 replaces in containers that do not hold them."""
_INTERMEDIATE = ("prores", "dnxhd", "cfhd")
_EDITING = ("matroska", "avi", "nut", "mxf", "mov")
"""Containers of lossless and intermediate codecs."""
_INTEGER = ("rgb48le", "rgba64le", "gray16le")
"""Of raw video: readers of it know no floats, whose light would be read as linear."""
_WHOLE_YUV = ("yuv444p", "yuv444p10le", "yuv444p12le", "yuv444p16le")
"""Of raw video where the container, such as Y4M, holds no RGB."""
_EVEN = ("libx264", "libx265")
"""Encoders whose sizes must be multiples of the chroma subsampling."""
_NO_ORDER = ("avi", "asf", "mxf")
"""Containers that store decoding times only: no B-frames."""
_MXF_GROUP = 128
"""Most pictures from key frame to key frame that MXF's index counts [1]; x264's default is 250."""
_FALLBACKS = ("libx264", "libvpx-vp9", "mpeg2video")
_CHOOSY = ("dnxhd", "dvvideo", "h263", "mpeg1video", "mpeg2video", "cfhd", "v210", "flv", "msmpeg4")
"""Encoders that refuse some sizes or rates."""
_MPEG_RATES = (
    24, 25, 30, 50, 60, *(Fraction(n * 1000, 1001) for n in (24, 30, 60))
)  # fmt: skip
"""Frame rates that the header of MPEG-1, MPEG-2 or MXF can express [1/s]."""
_FIXED_RATE = ("mpeg1video", "mpeg2video")
_MPEG4_LARGEST = 65535
"""Largest denominator of a time base in an MPEG-4 part 2 header."""
Holds = Callable[[str, str], bool]
"""Whether a container holds pictures of an encoder in a pixel format."""


class Encoding(Struct, frozen=True, kw_only=True):
    """How pictures are encoded.

    Attributes:
        codec: FFmpeg's name of the encoder.
        pixel_format: FFmpeg's name of the encoder's input format.
        options: of the encoder.
        reasons: differences from the source, and why.
    """

    codec: str
    pixel_format: str
    options: dict[str, str]
    reasons: tuple[str, ...] = ()


def choose_encoding(
    info: SourceInfo, holds: Holds, container: str, *, default: str = "none",
    codec: str | None = None, crf: float | None = None, pix_fmt: str | None = None,
) -> Encoding:  # fmt: skip
    """Keep the source's codec family and pixel format where container and encoder can.

    Args:
        info: the source.
        holds: whether the container holds pictures of an encoder in a pixel format.
        container: its name, for the reasons.
        default: the container's default video codec; `none` without one.
        codec: the user's encoder or codec family.
        crf: the user's quality.
        pix_fmt: the user's pixel format.

    Raises:
        UsageError: codec, quality or pixel format do not exist or do not go together.
        OutputError: the container holds no codec for such pictures.
    """
    if codec is not None:
        name = encoder_called(codec)
        if not holds(name, some_format(name)):
            raise UsageError(not_held(codec, container))
        why = ""
    else:
        name, why = _encoder(info, holds, container, default)
    if pix_fmt is not None:
        rgb = name == "libx264rgb" and codec is None
        name = "libx264" if rgb and "rgb" not in pix_fmt else name
        check_pixel_format(pix_fmt, name)
    wanted = pix_fmt or working_format(info.pixel_format)
    chosen = pix_fmt or _format(info, name, holds)
    if not chosen or not holds(name, chosen):
        raise UsageError(
            f"{container} does not hold {name} in {chosen or wanted}; "
            "give another OUT, --codec or --pix-fmt"
        )
    options = encoder_options(
        name, chosen, crf, interlaced=info.interlaced, field_order=info.field_order
    )
    if info.lossless and crf is None:
        options = without_loss(options, name)
    options, lost_hdr = with_hdr(options, name, info.hdr)
    reasons = [*lost_hdr, *([why] if why else [])]
    if lost := what_is_lost(wanted, chosen, name):
        told = f"pixel format {chosen} instead of {wanted}: nearest that {name} takes"
        reasons.append("; ".join((told, *lost)))
    reasons += clipped_light(info, chosen)
    reasons += unmarked_fields(name, interlaced=info.interlaced)
    if container in _NO_ORDER:
        options["bf"] = "0"
    if container == "mxf" and name in ("libx264", "libx264rgb"):
        options["g"] = str(_MXF_GROUP)
    return Encoding(codec=name, pixel_format=chosen, options=options, reasons=tuple(reasons))


def _has_alpha(pixel_format: str) -> bool:
    return any(one.is_alpha for one in av.VideoFormat(pixel_format).components)


def _encoder(info: SourceInfo, holds: Holds, container: str, default: str) -> tuple[str, str]:
    """The first usable encoder, and why it is not the source's."""
    for name in _candidates(info, container, default):
        chosen = "" if is_recent(container, name) else _format(info, name, holds)
        if chosen and _opens(info, name, chosen):
            break
    else:
        width, height = info.stored_size
        raise OutputError(
            f"{container} holds nothing for pictures of {width}x{height} in {info.pixel_format} at "
            f"{float(info.average_rate or 0):.4g} frames per second ({info.codec}); "
            "give another OUT, such as .mp4, .mov or .mkv"
        )
    own = _own(info)
    if info.kind in ("still", "sequence") or canonical(name) == canonical(info.codec):
        return name, ""
    why = f"{container} does not hold it" if own else "it has no encoder here"
    if own and not is_recent(container, own) and _format(info, own, holds):
        why = "its encoder refuses such pictures"
    return name, f"codec {name} instead of the source's {canonical(info.codec)}: {why}"


def _own(info: SourceInfo) -> str:
    """The encoder of the source's codec; empty without one."""
    name = encoder_of(info.codec)
    known = name != info.codec or name in _SAME
    return name if known and info.kind not in ("still", "sequence") else ""


def _candidates(info: SourceInfo, container: str, default: str) -> Iterator[str]:
    """Encoders in the order of preference."""
    if default == "none" or (container == "mxf" and info.average_rate not in _MPEG_RATES):
        return
    own = _own(info)
    if own == "libx264" and av.VideoFormat(working_format(info.pixel_format)).is_rgb:
        own = "libx264rgb"
    if own:
        yield own
    if container in _EDITING and info.codec in _LOSSLESS:
        yield "ffv1"
    if container in _EDITING and info.codec in _INTERMEDIATE:
        yield from ("prores_ks", "dnxhd")
    yield from _FALLBACKS
    yield from (encoder_of(default), "rawvideo")


def _opens(info: SourceInfo, name: str, pixel_format: str) -> bool:
    """Whether an encoder accepts the source's size and rate."""
    if name in ("mpeg1video", "mpeg2video") and info.average_rate not in _MPEG_RATES:
        return False
    if name not in _CHOOSY:
        return True
    context = av.CodecContext.create(name, "w")
    assert isinstance(context, VideoCodecContext)
    context.width, context.height = info.stored_size
    context.pix_fmt = pixel_format
    context.framerate = info.average_rate or Fraction(25)
    context.time_base = 1 / context.framerate
    context.options = encoder_options(name, pixel_format, None, interlaced=info.interlaced)
    try:
        with ordinary_priority():
            context.open()
    except (av.FFmpegError, ValueError):
        return False
    return True


def _formats(info: SourceInfo, name: str) -> list[str]:
    """Input formats for an encoder, the best first.

    The source's, or the nearest that it accepts; those that more containers hold follow.
    """
    wanted = working_format(info.pixel_format)
    formats, kind = shown_formats(name), layout(wanted)
    if not formats and kind is not None and kind.family == "float":
        formats = list(_INTEGER)
    if not formats or wanted in formats:
        best = wanted
    else:
        best = nearest_format(wanted, formats, name)
    choices = [best]
    if not formats:
        choices.append(nearest_format(best, list(_WHOLE_YUV), name))
    if _has_alpha(best):
        plain = [one for one in formats if not _has_alpha(one)]
        choices += ["yuva420p"] if "yuva420p" in formats else []
        choices += [nearest_format(wanted, plain, name)] if plain else []
    if name in _EVEN and layout(best) and any(size % 2 for size in info.stored_size):
        choices = [one.replace("420", "444").replace("422", "444") for one in choices]
    return choices


def _format(info: SourceInfo, name: str, holds: Holds) -> str:
    """The best input format of an encoder that the container holds; empty without one."""
    return next((one for one in _formats(info, name) if holds(name, one)), "")


def encoder_clock(codec: str, container: str, info: SourceInfo) -> EncoderClock:
    """The clock that suits an encoder and a container."""
    rate = info.average_rate or Fraction(25)
    if counts_pictures(container):
        return CountingClock(info, rate, container)
    # AVI stores a frame for each tick of its clock, no times; readers count ticks as frames
    fixed = codec in _FIXED_RATE or (container == "avi" and info.steady)
    fine = codec == "mpeg4" and info.time_base.denominator > _MPEG4_LARGEST
    if fixed or fine:
        return FixedRateClock(info, rate)
    if container in MP4_FAMILY and GridClock.suits(info):
        grid = GridClock(info)
        if codec != "mpeg4" or grid.time_base.denominator <= _MPEG4_LARGEST:
            return grid
    return EncoderClock(info)
