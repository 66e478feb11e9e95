"""Pixel formats: layouts of the working formats, lossless unpacking of others, conversion."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

import av
import numpy as np
import numpy.typing as npt
from av.video.reformatter import Interpolation

from nlens_video.core.color import FULL_RANGE, MATRICES, ColorTags, Family
from nlens_video.core.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelLayout:
    """Layout of the samples of a working format.

    Attributes:
        family: kind of samples.
        bits: of a sample; 0 for float.
        components: plane and position within the plane's pixel of the first, second, third
            component (Y Cb Cr or R G B) and of alpha; greyscale has one, alpha may be missing.
        channels: samples per pixel in a plane; 1 for planar formats.
        alpha: whether the last component is alpha.
        step_x: pixels per chroma sample along a row [px].
        step_y: pixels per chroma sample along a column [px].
        full_range: whether the name itself says full range (`yuvj`).
    """

    family: Family
    bits: int
    components: tuple[tuple[int, int], ...]
    channels: int = 1
    alpha: bool = False
    step_x: int = 1
    step_y: int = 1
    full_range: bool = False

    @property
    def dtype(self) -> str:
        """NumPy name of the type of a sample."""
        return "uint8" if self.bits == 8 else "uint16" if self.bits else "float32"


_YUV = re.compile(r"yuv([aj]?)(420|422|444|411|440|410)p(?:(\d+)le)?")
_STEPS = {"420": (2, 2), "422": (2, 1), "444": (1, 1), "411": (4, 1), "440": (1, 2), "410": (4, 4)}
_GBR = re.compile(r"gbr(a?)p(?:(f?)(\d+)le)?")
_GRAY = re.compile(r"(gray|ya)(?:(f?)(\d+)(?:le)?)?")
_PACKED = re.compile(
    r"(?:rgb|bgr)(?:24|48le|f32le)|(?:rgb|bgr)a(?:64le|f32le)?|(?:rgb|bgr)0|[a0](?:rgb|bgr)"
)

_SWS = (
    Interpolation.BICUBIC
    | Interpolation.ACCURATE_RND
    | Interpolation.FULL_CHR_H_INT
    | Interpolation.FULL_CHR_H_INP
)

_BT601 = 5
"""Number of the matrix that libswscale converts into; as a target it does not know 6."""

WORKING_FORMATS = {
    **dict.fromkeys(("nv12", "nv21"), "yuv420p"),
    **dict.fromkeys(("nv16", "yuyv422", "uyvy422", "yvyu422"), "yuv422p"),
    **dict.fromkeys(("nv24", "nv42", "vyu444", "vuyx"), "yuv444p"),
    "uyyvyy411": "yuv411p",
    **dict.fromkeys(("vuya", "ayuv", "uyva"), "yuva444p"),
    "ayuv64le": "yuva444p16le",
    "p010le": "yuv420p10le",
    "p012le": "yuv420p12le",
    "p016le": "yuv420p16le",
    **dict.fromkeys(("p210le", "nv20le", "y210le"), "yuv422p10le"),
    **dict.fromkeys(("p212le", "y212le"), "yuv422p12le"),
    "p216le": "yuv422p16le",
    **dict.fromkeys(("p410le", "xv30le"), "yuv444p10le"),
    **dict.fromkeys(("p412le", "xv36le"), "yuv444p12le"),
    "p416le": "yuv444p16le",
    "pal8": "rgba",
    **dict.fromkeys(("monow", "monob"), "gray"),
    **dict.fromkeys(("rgb565le", "rgb555le", "rgb444le", "bgr565le", "bgr555le"), "rgb24"),
    **dict.fromkeys(("bgr444le", "rgb8", "bgr8", "rgb4_byte", "bgr4_byte"), "rgb24"),
    **dict.fromkeys(("x2rgb10le", "x2bgr10le"), "gbrp10le"),
    "xyz12le": "rgb48le",
}
"""Working format of packed formats; big-endian ones are converted to little-endian first."""


def working_format(name: str) -> str:
    """The working format of a pixel format, into which it is converted without loss.

    Raises:
        InputError: it is not supported.
    """
    if layout(name) is not None:
        return name
    little = re.sub(r"be$", "le", name)
    if layout(little) is not None:
        return little
    if little in WORKING_FORMATS:
        return WORKING_FORMATS[little]
    raise InputError(
        f"pixel format {name} cannot be composited on; convert the plate first, "
        "for example with ffmpeg -i IN -pix_fmt yuv444p16le OUT.mkv"
    )


@lru_cache(maxsize=256)
def layout(name: str) -> PixelLayout | None:
    """Layout of a working format; None for other formats."""
    if match := _YUV.fullmatch(name):
        kind, sampling, bits = match.groups()
        step_x, step_y = _STEPS[sampling]
        planes = 4 if kind == "a" else 3
        return PixelLayout(
            family="yuv", bits=int(bits or 8), components=tuple((i, 0) for i in range(planes)),
            alpha=kind == "a", step_x=step_x, step_y=step_y, full_range=kind == "j",
        )  # fmt: skip
    if match := _GBR.fullmatch(name):
        alpha, real, depth = match.groups()
        order = ((2, 0), (0, 0), (1, 0), (3, 0))
        return PixelLayout(
            family="float" if real else "rgb", bits=0 if real else int(depth or 8),
            components=order[: 4 if alpha else 3], alpha=bool(alpha),
        )  # fmt: skip
    if match := _GRAY.fullmatch(name):
        return _gray(*match.groups())
    return _packed(name) if _PACKED.fullmatch(name) else None


def _gray(kind: str, real: str | None, depth: str | None) -> PixelLayout | None:
    if real and depth != "32":
        return None
    channels = 2 if kind == "ya" else 1
    return PixelLayout(
        family="float" if real else "gray", bits=0 if real else int(depth or 8),
        components=tuple((0, i) for i in range(channels)), channels=channels, alpha=channels == 2,
    )  # fmt: skip


def _packed(name: str) -> PixelLayout:
    letters = re.sub(r"(f32le|64le|48le|24)$", "", name)
    order = [letters.index(letter) for letter in "rgba" if letter in letters]
    deep = name.endswith(("48le", "64le"))
    real = name.endswith("f32le")
    return PixelLayout(
        family="float" if real else "rgb", bits=0 if real else 16 if deep else 8,
        components=tuple((0, place) for place in order), channels=len(letters),
        alpha="a" in letters,
    )  # fmt: skip


def unpacked(frame: av.VideoFrame) -> av.VideoFrame:
    """The frame in its working format, rows from the top; the same frame where it is so.

    Raises:
        InputError: its format is not supported.
    """
    target = working_format(frame.format.name)
    if target != frame.format.name:
        return converted(frame, target)
    return _from_the_top(frame) if any(one.line_size < 0 for one in frame.planes) else frame


def _from_the_top(frame: av.VideoFrame) -> av.VideoFrame:
    """A copy of a frame whose rows lie in memory from the bottom up, as FFmpeg's of PFM files."""
    made = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for mine, theirs in zip(made.planes, frame.planes, strict=True):
        rows, own = (
            np.frombuffer(memoryview(one), np.uint8).reshape(one.height, abs(one.line_size))
            for one in (theirs, mine)
        )
        width = min(rows.shape[1], own.shape[1])
        own[:, :width] = rows[::-1, :width]
    take_tags(made, frame)
    made.duration = frame.duration
    return made


def resized(frame: av.VideoFrame, width: int, height: int) -> av.VideoFrame:
    """The frame in another size, its format and tags kept."""
    matrix = frame.colorspace if frame.colorspace not in (0, 2) else 1
    span = frame.color_range or 1
    result = frame.reformat(
        width=width, height=height, src_colorspace=matrix, dst_colorspace=matrix,
        src_color_range=span, dst_color_range=span, interpolation=_SWS,
    )  # fmt: skip
    copy_colour_tags(result, frame)
    return result


def recoded(frame: av.VideoFrame, was: ColorTags, becomes: ColorTags) -> av.VideoFrame:
    """The frame, of YUV, in the codes of another matrix and range; its tags are to be set."""
    matrices = {name: number for number, name in MATRICES.items()} | {"smpte170m": _BT601}
    name, full = frame.format.name, FULL_RANGE
    plain = name.replace("yuvj", "yuv")
    if plain != name:  # libswscale takes yuvj for full range, whatever it is told
        frame = frame.reformat(format=plain, src_color_range=full, dst_color_range=full)
    return frame.reformat(
        format=name, src_colorspace=matrices[was.matrix], dst_colorspace=matrices[becomes.matrix],
        src_color_range=full if was.full_range else 1,
        dst_color_range=full if becomes.full_range else 1, interpolation=_SWS,
    )  # fmt: skip


def copy_colour_tags(made: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Copy the colour tags of a frame to one that was made from it."""
    for name in ("colorspace", "color_range", "color_primaries", "color_trc"):
        setattr(made, name, getattr(frame, name))


def take_tags(made: av.VideoFrame, frame: av.VideoFrame) -> None:
    """Copy the time and the colour tags of a frame to one that was made from it."""
    made.pts = frame.pts
    if frame.time_base is not None:  # frames that no decoder has made have none
        made.time_base = frame.time_base
    copy_colour_tags(made, frame)


def copied(frame: av.VideoFrame) -> av.VideoFrame:
    """A frame with samples of its own."""
    copy = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for mine, theirs in zip(copy.planes, frame.planes, strict=True):
        rows, own = _rows(theirs), _rows(mine)
        height, width = np.minimum(rows.shape, own.shape)
        own[:height, :width] = rows[:height, :width]
    take_tags(copy, frame)
    return copy


def _rows(plane: av.video.plane.VideoPlane) -> npt.NDArray[np.uint8]:
    """The bytes of a plane by rows, padding included; a palette, which has no rows, as one."""
    flat = np.frombuffer(memoryview(plane), np.uint8)
    return flat.reshape(-1, plane.line_size or plane.buffer_size)


def _is_grey(name: str) -> bool:
    return _GRAY.match(name) is not None


def converted(
    frame: av.VideoFrame, target: str, tags: ColorTags | None = None, *, limited: bool = False,
    bt601: bool = False,
) -> av.VideoFrame:  # fmt: skip
    """The frame in another pixel format, at its own time.

    Between two YUV or two RGB formats matrix and range stay, but with `limited` YUV becomes
    limited. YUV to RGB uses `tags`; RGB or grey to YUV uses BT.709, or with `bt601` that, in
    limited range, or for `yuvj` BT.601 in full range as in JPEG, and tags the result so.

    Args:
        frame: any.
        target: FFmpeg's name of a pixel format.
        tags: colour tags of the frame; needed from YUV to RGB.
        limited: whether YUV of full range is to become limited; for YUV alone.
        bt601: whether RGB or grey is to become YUV of BT.601.
    """
    was, becomes = av.VideoFormat(frame.format.name).is_rgb, av.VideoFormat(target).is_rgb
    matrix = frame.colorspace if frame.colorspace not in (0, 2) else 1
    span = frame.color_range or 1
    if tags is not None and not was and tags.matrix != "gbr":
        matrix = next(number for number, name in MATRICES.items() if name == tags.matrix)
        span = FULL_RANGE if tags.full_range else 1
    to_yuv = (was or _is_grey(frame.format.name)) and not becomes and not _is_grey(target)
    jpeg = target.startswith("yuvj")
    made = (5 if jpeg or bt601 else 1) if to_yuv else matrix
    result = frame.reformat(
        format=target, src_colorspace=matrix, dst_colorspace=made,
        src_color_range=span,
        dst_color_range=FULL_RANGE if jpeg else 1 if to_yuv or limited else span,
        interpolation=_SWS,
    )  # fmt: skip
    result.color_primaries, result.color_trc = frame.color_primaries, frame.color_trc
    result.colorspace = made if to_yuv else 0 if becomes else frame.colorspace
    if to_yuv or becomes:
        result.color_range = FULL_RANGE if becomes or jpeg else 1
    else:
        result.color_range = 1 if limited else FULL_RANGE if jpeg else frame.color_range
    result.pts, result.duration = frame.pts, frame.duration
    if frame.time_base is not None:
        result.time_base = frame.time_base
    return result
