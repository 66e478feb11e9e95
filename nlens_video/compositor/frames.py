"""Frames of a compositor: arrays, tensors and PyAV's in and out, and HTML for notebooks."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit

if TYPE_CHECKING:
    import av

Frames = TypeVar("Frames")
"""An array or a tensor, in a stream also one of PyAV's frames; results have the same type."""

_WIDEST_PX = 640  # of the picture in a notebook
_TYPES = (np.uint8, np.uint16, np.float32)  # that are composited in
_THIN = 8  # every so many rows and columns of floats are tested


def to_samples(frame: object, out: object = None) -> npt.NDArray[Any]:
    """A copy of a frame in a sample type that can be composited.

    Half precision and foreign byte order are converted, without loss.

    Args:
        frame: a numpy array, or a torch tensor.
        out: array that takes the copy, perhaps the frame itself; None for a new one.

    Raises:
        InputError: another sample type, or floating samples of which most are not in [0, 1].
        UsageError: neither an array nor a tensor, or an `out` that cannot take the copy.
    """
    if _is_tensor(frame):
        if out is not None:
            raise UsageError("out takes the result of an array, not of a tensor; leave it out")
        on_cpu: Any = frame
        on_cpu = on_cpu.detach().cpu()
        if on_cpu.is_floating_point() and on_cpu.element_size() == 2:
            on_cpu = on_cpu.float()  # numpy has no bfloat16
        frame = on_cpu.numpy()
    if not isinstance(frame, np.ndarray):
        kind = type(frame).__name__
        use = "; process_av takes PyAV's frames" if kind == "VideoFrame" else ""
        raise UsageError(f"process takes a numpy array or a torch tensor, not {kind}{use}")
    half = frame.dtype.kind == "f" and frame.dtype.itemsize == 2
    native = np.dtype(np.float32) if half else frame.dtype.newbyteorder("=")
    if native not in _TYPES:
        raise InputError(
            f"a frame of {frame.dtype}; expected uint8, uint16, float32 or half precision"
        )
    result = frame.astype(native) if out is None else _taking(frame, out)
    if native == np.float32 and frame.ndim > 1:
        _check_floats(result[::_THIN, ::_THIN])
    return result


def _check_floats(some: npt.NDArray[Any]) -> None:
    """Refuse frames of another range. Single samples beyond it, or NaN, are as in a file's plate.

    Args:
        some: a part of the samples.

    Raises:
        InputError: most of them are not finite, or exceed 1.
    """
    if 2 * np.count_nonzero(np.isfinite(some)) < some.size:
        raise InputError(
            "most of the float samples are NaN or infinite; expected [0, 1]: look at what made them"
        )
    if 2 * np.count_nonzero(some > 1.0) > some.size:
        raise InputError(
            "most of the float samples exceed 1; expected [0, 1]: divide by the white level, "
            "such as 255"
        )


def _taking(frame: npt.NDArray[Any], out: object) -> npt.NDArray[Any]:
    """`out`, with the samples of a frame."""
    wanted = f"an array {frame.shape} of {frame.dtype}"
    if not isinstance(out, np.ndarray):
        raise UsageError(f"out takes {wanted}, not {type(out).__name__}")
    if (out.shape, out.dtype) != (frame.shape, frame.dtype) or not out.flags.writeable:
        locked = "" if out.flags.writeable else ", which is read-only"
        raise UsageError(f"out is {out.shape} of {out.dtype}{locked}; expected {wanted}")
    if out.dtype not in _TYPES:
        raise UsageError(f"out of {out.dtype} cannot be composited in place; leave it out")
    if out is not frame:
        np.copyto(out, frame)
    return out


def from_samples(result: npt.NDArray[Any], frame: Frames) -> Frames:
    """A composited copy as the type of the frame that it was made from."""
    given: Any = frame
    if _is_tensor(frame):
        return cast("Frames", given.new_tensor(result))
    return cast("Frames", result.astype(given.dtype, copy=False))


def reformatted(result: av.VideoFrame, frame: av.VideoFrame) -> av.VideoFrame:
    """One of PyAV's frames in the format, and with time and tags, of the one it was made from.

    Raises:
        InputError: FFmpeg cannot make that format.
    """
    from nlens_video.video.pixels.conversion import take_tags

    if result.format.name == frame.format.name:
        return result
    # packed formats are composited in a planar one that holds the same samples
    try:
        packed = result.reformat(format=frame.format.name)
    except (OSError, ValueError) as error:  # FFmpeg's errors are of the first kind
        raise InputError(
            f"a frame of {frame.format.name}: FFmpeg reads but does not write it; reformat it, "
            "to rgb24 for example"
        ) from error
    take_tags(packed, frame)
    return packed


def _is_tensor(frame: object) -> bool:
    return type(frame).__module__ == "torch"  # a caller that has tensors has imported it


@dataclass(frozen=True, slots=True)
class Shown:
    """The state of a compositor; a notebook renders it as HTML.

    Attributes:
        picture: the last composite as a JPEG file, None before the first frame.
        size: its width and height [px].
        fit: the lens, None until it is found.
        plan: what runs, a line each.
    """

    picture: bytes | None = field(repr=False)
    size: tuple[int, int]
    fit: LensFit | None
    plan: tuple[str, ...]

    def _repr_html_(self) -> str:
        """HTML for Jupyter, self-contained."""
        parts = ["<p>no frame yet</p>"]
        if self.picture is not None:
            from nlens_video.report.html import embedded_jpeg

            parts = [embedded_jpeg(self.picture, self.size, "The last composite")]
        if self.fit is not None:
            parts.append(
                f"<p>coc_px = {self.fit.slope:.4g} &middot; disparity {self.fit.intercept:+.4g}, "
                f"sign {escape(self.fit.sign)}</p>"
            )
        lines = "".join(f"<li>{escape(line)}</li>" for line in self.plan)
        return "".join(parts) + (f"<ul>{lines}</ul>" if lines else "")


def show(picture: Picture | None, fit: LensFit | None, plan: tuple[str, ...]) -> Shown:
    """Shrink the last composite; `picture` is None before the first frame."""
    if picture is None:
        return Shown(None, (0, 0), fit, plan)
    from nlens_video.report.html import jpeg, to_8_bit

    image = to_8_bit(picture.shown(), _WIDEST_PX)
    return Shown(jpeg(image), (image.shape[1], image.shape[0]), fit, plan)
