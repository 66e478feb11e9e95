"""Pixel formats: layouts of the working formats, and which of them holds another format."""

from __future__ import annotations

import re
from functools import lru_cache

from msgspec import Struct

from nlens_video.core.color import Family
from nlens_video.core.errors import InputError


class PixelLayout(Struct, frozen=True, kw_only=True):
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


def working_layout(name: str) -> PixelLayout | None:
    """Layout of the working format of a pixel format; None where that is not supported."""
    try:
        return layout(working_format(name))
    except InputError:
        return None


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
