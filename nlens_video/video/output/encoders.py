"""FFmpeg's video encoders: codecs, options, pixel formats and qualities."""

from __future__ import annotations

import av
from av.codec.codec import Capabilities

from nlens_video.core.errors import UsageError
from nlens_video.video.info import SourceInfo
from nlens_video.video.pixels.display_codes import is_float, is_light
from nlens_video.video.pixels.pixel_formats import PixelLayout, layout, working_layout

# Decoder (or family) to encoder.
_ENCODERS = {
    "h264": "libx264", "hevc": "libx265", "vp8": "libvpx", "libvpx": "libvpx", "vp9": "libvpx-vp9",
    "libvpx-vp9": "libvpx-vp9", "av1": "libsvtav1", "libdav1d": "libsvtav1", "prores": "prores_ks",
    "flv1": "flv", "msmpeg4v3": "msmpeg4", "webp": "libwebp_anim", "h265": "libx265",
}  # fmt: skip
# Widths that are no multiple of 128 px: x264's vectorised macroblock tree reads uninitialised
# memory; its plain one, which this switch for equal results on all processors selects, does not.
_REPEATABLE = {"x264-params": "cpu-independent=1"}
_FIXED_SCALE = (
    "mjpeg", "mpeg4", "mpeg2video", "mpeg1video", "h263", "flv", "wmv1", "wmv2", "msmpeg4v2",
    "msmpeg4",
)  # fmt: skip
"""Encoders with a fixed quantiser scale, here of 2."""
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
    **dict.fromkeys(_FIXED_SCALE, {"flags": "+qscale", "global_quality": str(2 * 118)}),
}
_FIELDS = ("libx264", "mpeg2video", "mpeg4", "prores_ks")
"""Encoders that code fields when they are told to."""
_MARKING = (*_FIELDS, "ffv1", "dvvideo")
"""Encoders whose pictures say that they consist of two fields."""
_PLAYABLE = ("libx264", "libx265", "libvpx-vp9", "libvpx")
"""Encoders whose 4:2:0 is played everywhere, and whose 4:4:4 few players show."""
_SAMPLINGS = {(2, 1): "4:2:2", (2, 2): "4:2:0", (4, 1): "4:1:1", (1, 2): "4:4:0", (4, 4): "4:1:0"}
"""Names of chroma subsampling, by the pixels of a sample along a row and a column."""
_SHOWN_ALIKE = {
    "tiff": ("rgb24", "rgb48le", "rgba", "rgba64le", "gray", "gray16le", "ya8", "ya16le"),
    **dict.fromkeys(("libwebp", "libwebp_anim"), ("bgra",)),
}
"""Formats that all readers show alike, of encoders whose YUV they take for BT.601."""
_HIGHEST_CRF = {"libx264": 51, "libx264rgb": 51, "libx265": 51}
"""Of encoders whose options do not state it [1]."""


def encoder_of(codec: str) -> str:
    """The encoder for what a decoder reads, by FFmpeg's names; its own name where none is known."""
    return _ENCODERS.get(codec, codec)


def encoder_called(codec: str) -> str:
    """FFmpeg's name of an encoder that the user names by itself or by its codec family.

    Raises:
        UsageError: there is none, or it encodes no video.
    """
    name = encoder_of(codec)
    advice = "try libx264, libx265, prores_ks or ffv1"
    try:
        kind = av.Codec(name, "w").type
    except ValueError as error:
        raise UsageError(f"--codec {codec}: no such encoder; {advice}") from error
    if kind != "video":
        raise UsageError(f"--codec {codec}: encodes {kind}, not video; {advice}")
    return name


def not_held(codec: str, container: str) -> str:
    """Error message for an encoder that a container does not hold.

    Args:
        codec: as the user gave it.
        container: FFmpeg's name of it.
    """
    needs = Capabilities.hardware | Capabilities.hybrid
    if av.Codec(encoder_called(codec), "w").capabilities & needs:
        return f"--codec {codec}: needs hardware that is not at hand; give another encoder"
    return f"--codec {codec}: {container} does not hold it; give another OUT"


def check_crf(crf: float, encoder: str) -> None:
    """Refuse a quality that an encoder does not have.

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
    """Refuse a pixel format that does not exist or that an encoder does not accept.

    Raises:
        UsageError: it is refused.
    """
    try:
        av.VideoFormat(name)
    except ValueError as error:
        raise UsageError(f"--pix-fmt {name}: no such pixel format; try yuv420p") from error
    formats = [] if encoder is None else pixel_formats(encoder)
    if formats and name not in formats:
        raise UsageError(f"--pix-fmt {name}: {encoder} takes {', '.join(formats[:12])}")


def some_format(encoder: str) -> str:
    """A pixel format that an encoder accepts, for a trial."""
    formats = pixel_formats(encoder)
    return "yuv420p" if not formats or "yuv420p" in formats else formats[0]


def pixel_formats(encoder: str) -> list[str]:
    """Pixel formats that an encoder accepts; empty for any."""
    names = [one.name for one in av.Codec(encoder, "w").video_formats or ()]
    if encoder == "mjpeg":  # JPEG is full range
        return [name for name in names if name.startswith("yuvj")]
    return [name for name in names if name != "pal8"]  # palettes are not computed


def shown_formats(encoder: str) -> list[str]:
    """Those of its pixel formats whose colours readers show right; empty for any."""
    return list(_SHOWN_ALIKE.get(encoder, ())) or pixel_formats(encoder)


def encoder_options(
    encoder: str, pixel_format: str, crf: float | None, *, interlaced: bool, field_order: str = ""
) -> dict[str, str]:
    """Options of an encoder.

    Args:
        encoder: FFmpeg's name of it.
        pixel_format: its input format.
        crf: the user's quality.
        interlaced: whether frames consist of two fields.
        field_order: of `SourceInfo`.

    Raises:
        UsageError: the encoder has no such quality.
    """
    options = dict(_OPTIONS.get(encoder, {}))
    if encoder == "dnxhd" and "10" in pixel_format:
        options["profile"] = "dnxhr_hqx" if "422" in pixel_format else "dnxhr_444"
    if encoder == "libvpx" and pixel_format == "yuva420p":
        options["auto-alt-ref"] = "0"  # alternate reference frames exclude alpha
    if encoder == "prores_ks":
        options["profile"] = "4444" if "444" in pixel_format else "hq"
    if crf is not None:
        check_crf(crf, encoder)
        options["crf"] = f"{crf:g}"
    if interlaced and encoder in _FIELDS:
        options["flags"] = options.get("flags", "") + "+ildct+ilme"
    if interlaced and field_order and encoder in _MARKING:
        options["field_order"] = field_order
        if encoder == "libx264" and field_order[0] == "b":
            options["x264-params"] += ":bff=1"
    return options


def without_loss(options: dict[str, str], encoder: str) -> dict[str, str]:
    """Options of an encoder that keep samples to the bit, where it has them.

    Args:
        options: its usual ones.
        encoder: FFmpeg's name of it.
    """
    if encoder not in ("libx264", "libx264rgb", "libx265"):
        return options
    exact = {name: value for name, value in options.items() if name != "crf"}
    if encoder == "libx265":
        return {**exact, "x265-params": f"{options['x265-params']}:lossless=1"}
    return {**exact, "qp": "0"}


def unmarked_fields(encoder: str, *, interlaced: bool) -> tuple[str, ...]:
    """A note where interlaced pictures do not say any more that they are.

    Args:
        encoder: FFmpeg's name of it.
        interlaced: whether the source's frames consist of two fields.
    """
    if not interlaced or encoder in _MARKING:
        return ()
    return (f"interlaced pictures become whole frames: {encoder} does not mark their fields",)


def nearest_format(wanted: str, formats: list[str], codec: str) -> str:
    """The format that loses least; of several that lose nothing, the smallest."""
    goal = layout(wanted)
    # for RGB they would get 4:4:4
    if goal is None or (goal.family != "yuv" and codec in _PLAYABLE):
        if goal is not None and goal.alpha and "yuva420p" in formats:
            return "yuva420p"
        deep = goal is not None and goal.bits != 8
        name = "yuv420p10le" if deep and "yuv420p10le" in formats else "yuv420p"
        return name if name in formats else formats[0]
    return min(formats, key=lambda name: _loss(goal, name))


def what_is_lost(wanted: str, chosen: str, codec: str) -> tuple[str, ...]:
    """What pictures lose by another pixel format: colour, fine colour, bits, alpha, players.

    Not told is what nobody sees: samples that are rounded between YUV and RGB of as many bits.

    Args:
        wanted: the working format of the source.
        chosen: the encoder's input format.
        codec: FFmpeg's name of the encoder.
    """
    goal, kind = layout(wanted), working_layout(chosen)
    if goal is None or kind is None:
        return ()
    lost = []
    if goal.family != "gray" and kind.family == "gray":
        lost.append("colour is left out")
    elif goal.family != "gray" and kind.step_x * kind.step_y > goal.step_x * goal.step_y:
        lost.append(f"chroma in {_SAMPLINGS[kind.step_x, kind.step_y]}")
    elif kind.step_x * kind.step_y < goal.step_x * goal.step_y and codec in _PLAYABLE:
        lost.append("few players show it")
    if kind.bits and (kind.bits < goal.bits or not goal.bits):
        lost.append(f"{kind.bits} bits for {goal.bits or 'float'}")
    if goal.alpha and not kind.alpha:
        lost.append("alpha is left out")
    return tuple(lost)


def clipped_light(info: SourceInfo, chosen: str) -> tuple[str, ...]:
    """A note where a result cannot hold light that float samples of the source may hold.

    Args:
        info: the source.
        chosen: the encoder's input format.
    """
    if not is_light(info.pixel_format, info.tags) or is_float(chosen):
        return ()
    return (
        f"light above white (1.0) and below 0 is clipped: {chosen} does not hold it; .exr files do",
    )


def _loss(goal: PixelLayout, name: str) -> tuple[int, int, int, int, int, int]:
    """Loss of a format, by importance: colour, alpha, family, subsampling, bits, then waste."""
    kind = working_layout(name)
    if kind is None:
        return (9, 0, 0, 0, 0, 0)
    colour = int(goal.family != "gray" and kind.family == "gray")
    bits, want = kind.bits or 32, goal.bits or 32
    coarser = max(0, kind.step_x * kind.step_y - goal.step_x * goal.step_y)
    waste = len(kind.components) * bits * 4 // (kind.step_x * kind.step_y)
    family = int((kind.family == "yuv") != (goal.family == "yuv"))
    return colour, int(goal.alpha and not kind.alpha), family, coarser, max(0, want - bits), waste
