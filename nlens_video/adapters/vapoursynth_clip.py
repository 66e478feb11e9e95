"""An object in the frames of a VapourSynth clip."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import vapoursynth as vs

from nlens_video.adapters import contract
from nlens_video.compositor.compositor import Compositor
from nlens_video.core.errors import NlensError, UsageError
from nlens_video.core.settings import ObjectSettings
from nlens_video.video.info import FrameTags

FrameProperties = Mapping[str, Any]
"""Of a frame, by their names; integers where colour, time and form are concerned, or floats."""
_SAMPLING = {
    (1, 1): "420", (1, 0): "422", (0, 0): "444", (0, 1): "440", (2, 0): "411", (2, 2): "410",
}  # fmt: skip
_UNSPECIFIED = 2
_CHROMA_CENTRE, _CHROMA_TOP, _CHROMA_BOTTOM = 1, 3, 5
_GREEN_BLUE_RED = (1, 2, 0)
"""Where FFmpeg's planes G, B and R lie among VapourSynth's R, G and B."""
_MOST_SEARCHED = 1000
"""Frames that are composited to find the lens before the clip is returned."""


def composite(
    clip: vs.VideoNode,
    glb: str | Path | ObjectSettings,
    **options: Any,  # noqa: ANN401  as Compositor declares them
) -> vs.VideoNode:
    """Put an object into the frames of a clip.

    Frames may be asked for in any order and are the same bits: effects and light are found on frame
    0, the lens on the first frame that shows the object. These are composited here, before the clip
    is returned: frame 0 alone where the lens is given or no effect needs it, else 1000 frames at
    most. A lens that none of them shows is that of the first frame asked for that shows the object.

    Two options remember the frames before, and are for frames in order: `track_focus="auto"`, which
    is off by default here, and drifting exposure on a plate that pans or cuts
    (`effects="auto,-exposure"` leaves it out).

    The frame properties `_Matrix`, `_Transfer`, `_Primaries`, `_Range` (or `_ColorRange`),
    `_ChromaLocation` and `_SARNum`/`_SARDen` are honoured, and kept as all others are. The time of
    a frame is its number by the clip's rate, or `_AbsoluteTime` in a clip of variable rate. Frames
    of a constant rate without `_DurationNum` and `_DurationDen` get them.

    Args:
        clip: of one size and format: integer YUV, grey or RGB, grey or RGB of 32-bit floats.
        glb: the animated object.
        options: of a `Compositor`.

    Returns:
        A clip of the same format and length.

    Raises:
        vapoursynth.Error: the line of the error that the command line would give.
    """
    with _told_by_vapoursynth():
        rate = Fraction(clip.fps.numerator, clip.fps.denominator or 1)
        told = {"fps": float(rate)} if rate else {}
        lens = contract.open(glb, **{"track_focus": "off", **told, **options})
        try:
            composited = _Composited(lens, _pixel_format(clip), rate)
            _find_lens(clip, composited, lens)
        except BaseException:
            contract.close(lens)
            raise
        weakref.finalize(composited, _close_elsewhere, lens).atexit = False
        return clip.std.ModifyFrame(clips=clip, selector=composited)


def _find_lens(clip: vs.VideoNode, composited: _Composited, lens: Compositor) -> None:
    """Composite frame 0, and those after it up to the first that shows the object to a lens."""
    for number in range(min(clip.num_frames, _MOST_SEARCHED)):
        composited(number, clip.get_frame(number))
        if not lens.seeks_lens:
            return


def _close_elsewhere(lens: Compositor) -> None:
    """Close on a thread of its own: garbage may be collected on the compositor's, which it ends.

    VapourSynth lets clips go that live when Python ends, and no thread begins then; the end of the
    process frees what they hold.
    """
    closing = threading.Thread(target=contract.close, args=(lens,))
    try:
        closing.start()
    except RuntimeError:
        if threading.main_thread().is_alive():
            raise


class _Composited:
    """Composites the frames that VapourSynth asks for, in their order or in another.

    Args:
        lens: of the contract.
        pixel_format: FFmpeg's name.
        rate: of the clip, 0 where it varies [1/s].
    """

    def __init__(self, lens: Compositor, pixel_format: str, rate: Fraction) -> None:
        self._lens, self._format, self._rate = lens, pixel_format, rate

    def __call__(self, n: int, f: vs.VideoFrame) -> vs.VideoFrame:
        """The frame with the object; VapourSynth names these parameters."""
        made = f.copy()
        planes = [np.asarray(made[number]) for number in range(made.format.num_planes)]
        if made.format.color_family == vs.RGB:
            planes = [planes[number] for number in _GREEN_BLUE_RED]
        with _told_by_vapoursynth():
            contract.process(
                self._lens,
                contract.Frame(
                    pixel_format=self._format,
                    width=made.width,
                    height=made.height,
                    planes=tuple(planes),
                    tags=_tags(f.props),
                    time_s=self._time_s(n, f.props),
                    number=n,
                    centred_chroma=f.props.get("_ChromaLocation")
                    in (_CHROMA_CENTRE, _CHROMA_TOP, _CHROMA_BOTTOM)
                    and made.format.subsampling_w == 1,
                    pixel_aspect=_pixel_aspect(f.props),
                ),
            )
        if self._rate and "_DurationNum" not in f.props:
            made.props["_DurationNum"] = self._rate.denominator
            made.props["_DurationDen"] = self._rate.numerator
        return made

    def _time_s(self, number: int, props: FrameProperties) -> float:
        if self._rate:
            return float(number / self._rate)
        if "_AbsoluteTime" not in props:
            raise UsageError(
                "the clip's rate varies and its frames have no _AbsoluteTime; use a source that "
                "sets it, or std.AssumeFPS"
            )
        return float(props["_AbsoluteTime"])


@contextmanager
def _told_by_vapoursynth() -> Iterator[None]:
    """The package's errors as VapourSynth's, with the same line."""
    try:
        yield
    except NlensError as error:
        raise vs.Error(str(error)) from error


def _pixel_format(clip: vs.VideoNode) -> str:
    """FFmpeg's name of a clip's format.

    Raises:
        UsageError: the format or size varies, or cannot be composited in.
    """
    kind = clip.format
    if kind is None or not clip.width:
        raise UsageError("the clip's format or size varies; give a clip of one, or resize it")
    real = kind.sample_type == vs.FLOAT
    if kind.color_family == vs.YUV and not real:
        sampling = _SAMPLING.get((kind.subsampling_w, kind.subsampling_h))
        if sampling is not None:
            return f"yuv{sampling}p{_depth(kind)}"
    elif not real or kind.bits_per_sample == 32:
        family = {vs.RGB: "gbrp", vs.GRAY: "gray"}.get(kind.color_family)
        if family is not None:
            return family + ("f32le" if real else _depth(kind))
    raise UsageError(
        f"a clip of {kind.name}; expected integer YUV, or integer or 32-bit float RGB or grey: "
        "resize it, to YUV444P16 for example"
    )


def _depth(kind: vs.VideoFormat) -> str:
    return "" if kind.bits_per_sample == 8 else f"{kind.bits_per_sample}le"


def _tags(props: FrameProperties) -> FrameTags:
    """Colour tags of a frame by its properties."""
    span = 0
    if "_Range" in props:
        span = 1 + int(props["_Range"])
    elif "_ColorRange" in props:  # the older name, which counts the other way
        span = 2 - int(props["_ColorRange"])
    return FrameTags(
        colorspace=int(props.get("_Matrix", _UNSPECIFIED)),
        color_range=span,
        color_primaries=int(props.get("_Primaries", _UNSPECIFIED)),
        color_trc=int(props.get("_Transfer", _UNSPECIFIED)),
    )


def _pixel_aspect(props: FrameProperties) -> float | None:
    across, down = int(props.get("_SARNum", 0)), int(props.get("_SARDen", 0))
    return across / down if across > 0 and down > 0 else None
