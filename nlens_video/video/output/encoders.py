"""Encoders: which one makes a codec, its options, its pixel formats and its qualities."""

from __future__ import annotations

import av
from av.codec.codec import Capabilities

from nlens_video.core.errors import InputError, UsageError
from nlens_video.video.pixels.pixel_formats import PixelLayout, layout, working_format

# Decoder (or family) to encoder.
_ENCODERS = {
    "h264": "libx264", "hevc": "libx265", "vp8": "libvpx", "libvpx": "libvpx", "vp9": "libvpx-vp9",
    "libvpx-vp9": "libvpx-vp9", "av1": "libsvtav1", "libdav1d": "libsvtav1", "prores": "prores_ks",
    "flv1": "flv", "msmpeg4v3": "msmpeg4", "webp": "libwebp_anim",
}  # fmt: skip
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
    "libwebp_anim": {"quality": "90"},
    "ffv1": {"level": "3", "slicecrc": "1"},
    **{
        name: {"flags": "+qscale", "global_quality": str(2 * 118)}
        for name in (
            "mjpeg",
            "mpeg4",
            "mpeg2video",
            "mpeg1video",
            "h263",
            "flv",
            "wmv1",
            "wmv2",
            "msmpeg4v2",
            "msmpeg4",
        )
    },
}
_HIGHEST_CRF = {"libx264": 51, "libx264rgb": 51, "libx265": 51}
"""Of encoders whose own table of options does not bound it [1]."""


def encoder_of(codec: str) -> str:
    """The encoder for what a decoder reads, by FFmpeg's names; its own name where none is known."""
    return _ENCODERS.get(codec, codec)


def encoder_called(codec: str) -> str:
    """FFmpeg's name of the encoder that a user means by an encoder or a codec family.

    Raises:
        UsageError: there is none, or it is none of pictures.
    """
    name = _ENCODERS.get(codec, codec)
    advice = "try libx264, libx265, prores_ks or ffv1"
    try:
        kind = av.Codec(name, "w").type
    except ValueError as error:
        raise UsageError(f"--codec {codec}: no such encoder; {advice}") from error
    if kind != "video":
        raise UsageError(f"--codec {codec}: encodes {kind}, not video; {advice}")
    return name


def not_held(codec: str, container: str) -> str:
    """What to say of an encoder that could not be started in a container.

    Args:
        codec: as the user gave it.
        container: FFmpeg's name of it.
    """
    needs = Capabilities.hardware | Capabilities.hybrid
    if av.Codec(encoder_called(codec), "w").capabilities & needs:
        return f"--codec {codec}: needs hardware that is not at hand; give another encoder"
    return f"--codec {codec}: {container} does not hold it; give another OUT"


def check_crf(crf: float, encoder: str) -> None:
    """See that an encoder has such a quality.

    Raises:
        UsageError: it has no crf, or one of another range.
    """
    if "crf" not in _OPTIONS.get(encoder, {}):
        raise UsageError(f"--crf {crf:g}: {encoder} has no crf; leave it out or choose --codec")
    context = av.CodecContext.create(encoder, "w")
    highest = [one.max for one in context.supported_options.private if one.name == "crf"]
    limit = _HIGHEST_CRF.get(encoder, highest[0] if highest else 63)
    if not 0 <= crf <= limit:
        raise UsageError(f"--crf {crf:g}: {encoder} takes 0 (best) to {limit:g}")


def check_pixel_format(name: str, encoder: str | None) -> None:
    """See that there is such a pixel format and that an encoder takes it.

    Raises:
        UsageError: there is none, or it does not.
    """
    try:
        av.VideoFormat(name)
    except ValueError as error:
        raise UsageError(f"--pix-fmt {name}: no such pixel format; try yuv420p") from error
    formats = [] if encoder is None else pixel_formats(encoder)
    if formats and name not in formats:
        raise UsageError(f"--pix-fmt {name}: {encoder} takes {', '.join(formats[:12])}")


def some_format(encoder: str) -> str:
    """A pixel format that an encoder takes, to try it with."""
    formats = pixel_formats(encoder)
    return "yuv420p" if not formats or "yuv420p" in formats else formats[0]


def pixel_formats(encoder: str) -> list[str]:
    """Those that an encoder takes; empty: any."""
    names = [one.name for one in av.Codec(encoder, "w").video_formats or ()]
    if encoder == "mjpeg":  # limited range is no JPEG
        return [name for name in names if name.startswith("yuvj")]
    return [name for name in names if name != "pal8"]  # nothing here makes palettes


def encoder_options(
    encoder: str, pixel_format: str, crf: float | None, *, interlaced: bool
) -> dict[str, str]:
    """What an encoder is told.

    Args:
        encoder: FFmpeg's name of it.
        pixel_format: the one that it is given.
        crf: quality the user asks for.
        interlaced: whether frames are two fields.

    Raises:
        UsageError: the encoder has no such quality.
    """
    options = dict(_OPTIONS.get(encoder, {}))
    if encoder == "dnxhd" and "10" in pixel_format:
        options["profile"] = "dnxhr_hqx" if "422" in pixel_format else "dnxhr_444"
    if encoder == "libvpx" and pixel_format == "yuva420p":
        options["auto-alt-ref"] = "0"  # it refuses transparency with them
    if encoder == "prores_ks":
        options["profile"] = "4444" if "444" in pixel_format else "hq"
    if crf is not None:
        check_crf(crf, encoder)
        options["crf"] = f"{crf:g}"
    if interlaced and encoder in ("libx264", "mpeg2video"):
        options["flags"] = options.get("flags", "") + "+ildct+ilme"
    return options


def nearest_format(wanted: str, formats: list[str], codec: str) -> str:
    """The encoder's format that loses least, the smallest of those that lose nothing."""
    goal = layout(wanted)
    # x264 and its like would take 4:4:4, which few players show, for what came as RGB.
    playable = codec in ("libx264", "libx265", "libvpx-vp9", "libvpx")
    if goal is None or (goal.family != "yuv" and playable):
        if goal is not None and goal.alpha and "yuva420p" in formats:
            return "yuva420p"
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
