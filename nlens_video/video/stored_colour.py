"""Colour of a result's samples: what they mean, and what of it a reader is told."""

from __future__ import annotations

from collections.abc import Callable

import av
from av.video.codeccontext import VideoCodecContext
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.color import FULL_RANGE, TRANSFERS, ColorTags, luma
from nlens_video.video.info import FrameTags, SourceInfo
from nlens_video.video.pixels.conversion import matrix_of_primaries
from nlens_video.video.pixels.display_codes import SRGB_TRC, is_float, is_light
from nlens_video.video.pixels.pixel_formats import PixelLayout, working_layout

_LIMITED = 1
UNSAID = (0, 2)
"""FFmpeg's numbers of tags that say nothing."""
_HOLDING = ("matroska", "mov", "mp4")
"""Muxers that hold the tags of most encoders."""
SHOWN_ALIKE = ("bt709", "smpte170m", "bt2020-10", "bt2020-12", "iec61966-2-1")
"""Transfer functions that players show alike."""


class StoredColour(Struct, frozen=True, kw_only=True):
    """Colour of a result's samples.

    Attributes:
        pixel_format: FFmpeg's name.
        tags: of the samples.
        limited: whether samples of full range become limited.
        lost: names and values of the source's tags that a reader does not take them for.
    """

    pixel_format: str
    tags: FrameTags
    limited: bool = False
    lost: tuple[str, ...] = ()

    def notes(self, container: str, encoder: str) -> tuple[str, ...]:
        """What differs from the source.

        Args:
            container: FFmpeg's name of the muxer.
            encoder: FFmpeg's name of it.
        """
        notes = []
        if self.limited:
            notes.append(f"full range becomes limited: {encoder} in {container} is read as limited")
        if self.lost:
            advice = "" if container in _HOLDING else "; .mkv, .mov and .mp4 files do"
            tags = ", ".join(self.lost)
            notes.append(
                f"colour tags are left out ({tags}): {container} does not hold them for {encoder}"
                f"{advice}"
            )
        return tuple(notes)


def stored_colour(
    info: SourceInfo, pixel_format: str, read: Callable[[FrameTags], FrameTags]
) -> StoredColour:
    """Colour of the samples of a source in a pixel format.

    Args:
        info: the source.
        pixel_format: of the result, FFmpeg's name.
        read: what a reader finds of tags that are written.
    """
    tags = _tags(info, pixel_format)
    kind = working_layout(pixel_format)
    if kind is None or tags == FrameTags():
        return StoredColour(pixel_format=pixel_format, tags=tags)
    found = read(tags)
    meant = _resolved(kind, info, tags, FULL_RANGE if kind.full_range else tags.color_range)
    taken = _resolved(kind, info, found, found.color_range)
    limited = meant.full_range and not taken.full_range
    return StoredColour(
        pixel_format=pixel_format.replace("yuvj", "yuv") if limited else pixel_format,
        tags=replace(tags, color_range=_LIMITED) if limited else tags,
        limited=limited, lost=_lost(meant, taken),
    )  # fmt: skip


def siting_option(info: SourceInfo, pixel_format: str, container: str) -> dict[str, str]:
    """An encoder's option for chroma that does not lie where readers assume, on the left.

    Y4M always says where; without the option, that it is centred.

    Args:
        info: the source.
        pixel_format: of the result, FFmpeg's name.
        container: FFmpeg's name of the muxer.
    """
    kinds = (working_layout(info.pixel_format), working_layout(pixel_format))
    halved = all(kind is not None and (kind.step_x, kind.step_y) == (2, 2) for kind in kinds)
    siting = (info.chroma_siting if halved else "") or "left"
    told = siting != "left" or container == "yuv4mpegpipe"
    return {"chroma_sample_location": siting} if told else {}


def set_colour(told: VideoCodecContext | av.VideoFrame, tags: FrameTags) -> None:
    """Tell an encoder, or a frame, the colour of its samples."""
    told.colorspace, told.color_range = tags.colorspace, tags.color_range
    told.color_primaries, told.color_trc = tags.color_primaries, tags.color_trc


def _tags(info: SourceInfo, pixel_format: str) -> FrameTags:
    """The source's tags; after a conversion those of `converted` and `display_coded`."""
    tags = info.frame_tags
    if is_light(info.pixel_format, info.tags) and not is_float(pixel_format):
        tags = replace(tags, color_trc=SRGB_TRC)
    if av.VideoFormat(pixel_format).is_rgb:
        return replace(tags, colorspace=0, color_range=FULL_RANGE)
    if info.tags.matrix != "gbr" or "gray" in pixel_format:
        return tags
    jpeg = pixel_format.startswith("yuvj")
    return FrameTags(
        colorspace=5 if jpeg else matrix_of_primaries(tags.color_primaries),
        color_range=FULL_RANGE if jpeg else _LIMITED,
        color_primaries=1 if tags.color_primaries in UNSAID else tags.color_primaries,
        color_trc=SRGB_TRC if tags.color_trc in UNSAID else tags.color_trc,
    )  # fmt: skip


def _resolved(kind: PixelLayout, info: SourceInfo, tags: FrameTags, span: int) -> ColorTags:
    # a transfer function that --input-transfer replaces may be one that is not supported
    curve = tags.color_trc if tags.color_trc in TRANSFERS else 0
    return ColorTags.resolve(
        kind.family, info.stored_size, matrix=tags.colorspace, transfer=curve,
        primaries=tags.color_primaries, range_=span,
    )  # fmt: skip


def _lost(meant: ColorTags, taken: ColorTags) -> tuple[str, ...]:
    lost = []
    if (luma(meant.matrix) != luma(taken.matrix)).any():
        lost.append(f"matrix {meant.matrix}")
    curves = (meant.transfer, taken.transfer)
    if curves[0] != curves[1] and not set(curves).issubset(SHOWN_ALIKE):
        lost.append(f"transfer {meant.transfer}")
    if meant.primaries != taken.primaries:
        lost.append(f"primaries {meant.primaries}")
    return tuple(lost)
