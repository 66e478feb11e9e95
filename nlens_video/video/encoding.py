"""Which encoder, pixel format and options a result gets, and why where that is not the source's."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import av

from nlens_video.errors import InputError, UsageError
from nlens_video.video.formats import PixelLayout, layout, working_format
from nlens_video.video.info import SourceInfo

# Decoder (or family) to encoder.
_ENCODERS = {
    "h264": "libx264", "hevc": "libx265", "vp8": "libvpx", "libvpx": "libvpx", "vp9": "libvpx-vp9",
    "libvpx-vp9": "libvpx-vp9", "av1": "libsvtav1", "libdav1d": "libsvtav1", "prores": "prores_ks",
}  # fmt: skip
_SAME = (
    "ffv1", "ffvhuff", "huffyuv", "utvideo", "magicyuv", "mjpeg", "mpeg2video", "mpeg1video",
    "mpeg4", "dnxhd", "cfhd", "v210", "rawvideo", "qtrle", "png", "apng", "gif", "jpeg2000",
)  # fmt: skip
_FALLBACK = "libx264"
# Where pictures are no multiple of 128 px wide, x264's vectorised macroblock tree goes by what lay
# in memory before; its plain one, which this asks for (x264's switch for equal results on
# all processors), does not.
_REPEATABLE = {"x264-params": "cpu-independent=1"}
# Visually lossless at a speed that keeps up; each may be overridden by --crf where it has one.
_OPTIONS = {
    "libx264": {"crf": "16", "preset": "veryfast", **_REPEATABLE},
    "libx264rgb": {"crf": "16", "preset": "veryfast", **_REPEATABLE},
    "libx265": {"crf": "16", "preset": "fast", "x265-params": "log-level=error"},
    "libvpx-vp9": {"crf": "18", "b": "0", "deadline": "good", "cpu-used": "4", "row-mt": "1"},
    "libvpx": {"crf": "6", "b": "40M", "deadline": "good", "cpu-used": "4"},
    "libsvtav1": {"crf": "18", "preset": "8"},
    "prores_ks": {},
    "dnxhd": {"profile": "dnxhr_hq"},
    "cfhd": {"quality": "film3+"},
    "ffv1": {"level": "3", "slicecrc": "1"},
    **{
        name: {"flags": "+qscale", "global_quality": str(2 * 118)}
        for name in ("mjpeg", "mpeg4", "mpeg2video", "mpeg1video")
    },
}


_MPEG_RATES = (
    24, 25, 30, 50, 60, *(Fraction(n * 1000, 1001) for n in (24, 30, 60))
)  # fmt: skip
"""Frame rates that an MPEG-1 or MPEG-2 header can name [1/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoding:
    """How pictures are encoded.

    Attributes:
        codec: FFmpeg's name of the encoder.
        pixel_format: FFmpeg's name of the format that the encoder is given.
        options: of the encoder.
        reasons: what differs from the source, and why.
    """

    codec: str
    pixel_format: str
    options: dict[str, str]
    reasons: tuple[str, ...] = ()


def choose_encoding(
    info: SourceInfo, supported: set[str], container: str, *, codec: str | None = None,
    crf: float | None = None, pix_fmt: str | None = None,
) -> Encoding:  # fmt: skip
    """Keep the source's codec family and pixel format where container and encoder can.

    Args:
        info: the source.
        supported: names of the codecs that the container holds.
        container: its name, for the reasons.
        codec: an encoder or a codec family the user asks for.
        crf: quality the user asks for.
        pix_fmt: pixel format the user asks for.

    Raises:
        UsageError: what the user asks for does not exist or does not go together.
    """
    # Encoders take no such side data from the frames that they are given.
    reasons = ["HDR mastering metadata is not carried over"] if info.hdr_metadata else []
    name = _encoder(info, supported, container, codec, reasons)
    wanted = pix_fmt or working_format(info.pixel_format)
    if name == "libx264" and pix_fmt is None and codec is None and info.codec == "h264":
        name = "libx264rgb" if av.VideoFormat(wanted).is_rgb else name
    formats = _formats(name)
    if pix_fmt is not None:
        _check_format(pix_fmt, name, formats)
    chosen = wanted if not formats or wanted in formats else _nearest(wanted, formats, name)
    if name == "libx264" and layout(chosen) and any(size % 2 for size in info.stored_size):
        chosen = chosen.replace("420", "444").replace("422", "444")  # x264 wants even sizes
    if chosen != wanted:
        reasons.append(f"pixel format {chosen} instead of {wanted}: nearest that {name} takes")
    options = dict(_OPTIONS.get(name, {}))
    if name == "dnxhd" and "10" in chosen:
        options["profile"] = "dnxhr_hqx" if "422" in chosen else "dnxhr_444"
    if name == "prores_ks":
        options["profile"] = "4444" if "444" in chosen else "hq"
    if crf is not None:
        if "crf" not in options:
            raise UsageError(f"--crf {crf:g}: {name} has no crf; leave it out or choose --codec")
        options["crf"] = f"{crf:g}"
    if info.interlaced and name in ("libx264", "mpeg2video"):
        options["flags"] = options.get("flags", "") + "+ildct+ilme"
    return Encoding(codec=name, pixel_format=chosen, options=options, reasons=tuple(reasons))


def _encoder(
    info: SourceInfo, supported: set[str], container: str, codec: str | None, reasons: list[str]
) -> str:
    if codec is not None:
        name = _ENCODERS.get(codec, codec)
        try:
            kind = av.Codec(name, "w").type
        except ValueError as error:
            raise UsageError(
                f"--codec {codec}: no such encoder; try libx264, libx265, prores_ks or ffv1"
            ) from error
        if kind != "video" or name not in supported:
            raise UsageError(f"--codec {codec}: {container} does not hold it; give another OUT")
        return name
    picture = info.kind in ("still", "sequence")
    name = _ENCODERS.get(info.codec, info.codec if info.codec in _SAME and not picture else "")
    if name.startswith(("mpeg1", "mpeg2")) and info.average_rate not in _MPEG_RATES:
        name = ""
    if name and name in supported:
        return name
    for fallback in (_FALLBACK, "libvpx-vp9", "mpeg2video", "gif", "rawvideo"):
        if fallback in supported:
            break
    if not picture:
        why = f"{container} does not hold it" if name else "it has no encoder here"
        reasons.append(f"codec {fallback} instead of the source's {info.codec}: {why}")
    return fallback


def _formats(codec: str) -> list[str]:
    """Pixel formats that an encoder takes; empty: any."""
    names = [one.name for one in av.Codec(codec, "w").video_formats or ()]
    if codec == "mjpeg":  # limited range is no JPEG
        return [name for name in names if name.startswith("yuvj")]
    return [name for name in names if name != "pal8"]  # nothing here makes palettes


def _check_format(name: str, codec: str, formats: list[str]) -> None:
    try:
        av.VideoFormat(name)
    except ValueError as error:
        raise UsageError(f"--pix-fmt {name}: no such pixel format; try yuv420p") from error
    if formats and name not in formats:
        raise UsageError(f"--pix-fmt {name}: {codec} takes {', '.join(formats[:12])}")


def _nearest(wanted: str, formats: list[str], codec: str) -> str:
    """The encoder's format that loses least, the smallest of those that lose nothing."""
    goal = layout(wanted)
    # x264 and its like would take 4:4:4, which few players show, for what came as RGB.
    playable = codec in ("libx264", "libx265", "libvpx-vp9", "libvpx")
    if goal is None or (goal.family != "yuv" and playable):
        deep = goal is not None and goal.bits != 8
        name = "yuv420p10le" if deep and "yuv420p10le" in formats else "yuv420p"
        return name if name in formats else formats[0]
    return min(formats, key=lambda name: _loss(goal, name))


def _loss(goal: PixelLayout, name: str) -> tuple[int, int, int, int, int, int]:
    """What a format loses of another: colour, family, alpha, subsampling, bits, then waste."""
    try:
        kind = layout(working_format(name))
    except InputError:
        kind = None
    if kind is None:
        return (9, 0, 0, 0, 0, 0)
    colour = int(goal.family != "gray" and kind.family == "gray")
    bits, want = kind.bits or 32, goal.bits or 32
    coarser = max(0, kind.step_x * kind.step_y - goal.step_x * goal.step_y)
    waste = len(kind.components) * bits * 4 // (kind.step_x * kind.step_y)
    family = int((kind.family == "yuv") != (goal.family == "yuv"))
    return colour, int(goal.alpha and not kind.alpha), family, coarser, max(0, want - bits), waste
