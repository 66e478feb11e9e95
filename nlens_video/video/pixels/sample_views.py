"""Upright views of a frame's or an array's samples; nothing is copied or converted here."""

from __future__ import annotations

from dataclasses import replace

import av
import numpy as np

from nlens_video.core.color import TRANSFERS, ColorTags
from nlens_video.core.errors import InputError
from nlens_video.video.pixels.pixel_formats import PixelLayout, layout
from nlens_video.video.pixels.sample_tables import Axis, Coding, Plane, Samples


def frame_tags(frame: av.VideoFrame, *, assumed: int = 0, given: str | None = None) -> ColorTags:
    """What a frame's own tags say, and what has to be assumed.

    Args:
        frame: in a working format.
        assumed: FFmpeg's number of the transfer function to take where the frame names none.
        given: name of the one to take whatever the frame names.
    """
    kind = _layout(frame)
    transfer = frame.color_trc if frame.color_trc not in (0, 2) else assumed
    if given is not None:
        (transfer,) = (number for number, name in TRANSFERS.items() if name == given)
    return ColorTags.resolve(
        kind.family, (frame.width, frame.height), matrix=frame.colorspace,
        transfer=transfer, primaries=frame.color_primaries,
        range_=2 if kind.full_range else frame.color_range,
    )  # fmt: skip


def frame_samples(
    frame: av.VideoFrame, tags: ColorTags, turns: int, *, centred_chroma: bool = False
) -> Samples:
    """Views of a frame in a working format, turned `turns` quarter turns counter-clockwise.

    Chroma at half the width lies on the left luma column, or centred between two.
    """
    kind = _layout(frame)
    views = [_view(frame, kind, plane, place) for plane, place in kind.components]
    left = kind.step_x == 2 and not centred_chroma
    across = _axis(kind.step_x, left=left)
    return upright(views, kind, tags, (across, _axis(kind.step_y, left=False)), turns)


def array_samples(
    array: Plane, order: str, tags: ColorTags, *, associated: bool = False
) -> Samples:
    """Views of an array (H, W), (H, W, 3) or (H, W, 4) whose channels lie in `order`.

    Alpha is straight unless `associated` says that the colours are premultiplied by it.

    Raises:
        InputError: a shape or a type that no picture has.
    """
    bits = {"uint8": 8, "uint16": 16, "float32": 0}.get(array.dtype.name)
    channels = array.shape[2] if array.ndim == 3 else 1
    if bits is None or array.ndim not in (2, 3) or channels not in (1, 3, 4) or not array.size:
        raise InputError(
            f"a picture of shape {array.shape}, {array.dtype}; expected (H, W), (H, W, 3) or "
            "(H, W, 4) of uint8, uint16 or float32"
        )
    places = {"rgb": (0, 1, 2), "bgr": (2, 1, 0)}[order]
    views = [array[..., place] for place in (*places, 3)[:channels]] if channels > 1 else [
        array.reshape(array.shape[:2])
    ]  # fmt: skip
    kind = PixelLayout(
        family="rgb" if channels > 1 else "gray", bits=bits, components=((0, 0),) * channels,
        alpha=channels == 4,
    )  # fmt: skip
    return replace(upright(views, kind, tags, (Axis(), Axis()), 0), associated=associated)


def upright(
    views: list[Plane], kind: PixelLayout, tags: ColorTags, axes: tuple[Axis, Axis], turns: int
) -> Samples:
    """Samples as displayed, from views as stored and their subsampling across and down."""
    alpha = views.pop() if kind.alpha else None
    height, width = views[0].shape
    if len(views) == 1:  # greyscale: chroma that nothing reads, of the shape the kernels expect
        views += [np.zeros_like(views[0]), np.zeros_like(views[0])]
    for _ in range(turns % 4):
        axes = axes[1], _mirrored(axes[0], width)
        height, width = width, height
    family = "gray" if len(kind.components) - kind.alpha == 1 else "yuv"
    if tags.matrix == "gbr" and family == "yuv":
        family = "rgb"
    if turns % 4:
        views = [np.rot90(view, turns) for view in views]
        alpha = None if alpha is None else np.rot90(alpha, turns)
    return Samples(
        (views[0], views[1], views[2]),
        alpha,
        *axes,
        Coding(family, tags, kind.bits),
    )


def _layout(frame: av.VideoFrame) -> PixelLayout:
    kind = layout(frame.format.name)
    if kind is None:
        raise ValueError(f"{frame.format.name} is not a working format")
    return kind


def _view(frame: av.VideoFrame, kind: PixelLayout, plane: int, place: int) -> Plane:
    source = frame.planes[plane]
    flat: Plane = np.frombuffer(memoryview(source), np.dtype(kind.dtype))
    rows = flat.reshape(source.height, source.line_size // flat.itemsize)
    view: Plane = rows[:, place : source.width * kind.channels : kind.channels]
    return view


def _axis(step: int, *, left: bool) -> Axis:
    if left:
        return Axis(2, 0, -1, (0.25, 0.5, 0.25))
    return Axis(step, 0, 0, (1.0 / step,) * step)


def _mirrored(axis: Axis, length: int) -> Axis:
    """The same subsampling seen from the other end of `length` pixels."""
    return replace(
        axis,
        phase=-length % axis.step,
        first=axis.step - axis.first - len(axis.weights),
        weights=axis.weights[::-1],
    )
