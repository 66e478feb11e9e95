"""What every adapter calls: open, process, close.

The three functions and the fields of `Frame` are the contract. `VERSION` rises when one of them
changes its meaning or goes; new fields have defaults and do not raise it. An adapter keeps these
rules, and `tests/support/conformance.py` checks them on each:

- the same samples as the command line makes of the same frames,
- format, colour tags and time of a frame are those that came,
- an error is the command line's one line, and has its exit code.
"""

from __future__ import annotations

from difflib import get_close_matches
from inspect import signature
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from nlens_video.compositor.compositor import Compositor
from nlens_video.core.color import ColorTags
from nlens_video.core.errors import UsageError
from nlens_video.core.settings import ObjectSettings
from nlens_video.video.info import FrameTags
from nlens_video.video.pixels.memory_picture import Memory, MemoryPicture, picture_layout

VERSION = 1
"""Of the contract."""
OPTIONS = frozenset(signature(Compositor).parameters) - {"glb"}
"""Names of the options that `open` takes."""


class Frame(Struct, frozen=True, kw_only=True, eq=False):
    """One frame in the memory of the program that asks.

    Attributes:
        pixel_format: FFmpeg's name, such as `yuv420p10le`, `nv12` or `gbrp`.
        width: columns [px].
        height: rows [px].
        planes: as the format has them, each (rows, bytes of a row) or (rows, samples), padding
            included; writable.
        tags: matrix, range, primaries and transfer function by the numbers of ITU-T H.273, range
            as FFmpeg counts it (1 limited, 2 full); what is not specified is assumed as for files.
        time_s: since the stream's first frame; None: `number` / `fps` [s].
        number: position in the stream; None: frames so far [1].
        centred_chroma: whether chroma at half the width lies between two luma columns.
        pixel_aspect: width of a pixel by its height; None: as `open` was told [1].
    """

    pixel_format: str
    width: int
    height: int
    planes: tuple[Memory, ...]
    tags: FrameTags = field(default_factory=FrameTags)
    time_s: float | None = None
    number: int | None = None
    centred_chroma: bool = False
    pixel_aspect: float | None = None


def open(glb: str | Path | ObjectSettings, **options: Any) -> Compositor:  # noqa: ANN401  as Compositor declares them
    """Prepare for a stream of frames of one size.

    Args:
        glb: the animated object.
        options: of a `Compositor`; `fps` is the stream's rate.

    Returns:
        What `process` and `close` take; `fit`, `plan` and `timings` tell of it.

    Raises:
        UsageError: an option is unknown, out of range, or contradicts another.
        LensFitError: the saved fit cannot be read.
    """
    unknown = sorted(set(options) - OPTIONS)
    if unknown:
        near = get_close_matches(unknown[0], OPTIONS, 1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise UsageError(f"{', '.join(unknown)}: not an option of a Compositor{meant}")
    return Compositor(glb, **options)


def process(lens: Compositor, frame: Frame) -> None:
    """Composite one frame where it lies; frames may come from any thread, one after another.

    The lens is fitted on the first frame that shows the object, and effects and light are found on
    the first one; frames may follow in any order.

    Args:
        lens: of `open`.
        frame: its planes are changed; after an error they are as they were.

    Raises:
        InputError: a format or colour tags that cannot be composited in.
        UsageError: another size than before; close, and open again.
        SceneError: the GLB cannot be used.
        LensFitError: no usable lens fit.
    """
    kind, size, tags = picture_layout(frame.pixel_format), (frame.width, frame.height), frame.tags
    meaning = ColorTags.resolve(
        kind.family, size, matrix=tags.colorspace, transfer=tags.color_trc,
        primaries=tags.color_primaries, range_=2 if kind.full_range else tags.color_range,
    )  # fmt: skip
    picture = MemoryPicture(
        frame.planes, frame.pixel_format, size, meaning, centred_chroma=frame.centred_chroma
    )
    lens.composite(picture, frame.time_s, frame.number, frame.pixel_aspect)


def close(lens: Compositor) -> None:
    """Free OpenGL, networks and the thread; may be called again."""
    lens.close()
