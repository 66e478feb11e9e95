"""What happens to a plate on its way: a codec, noise, another size."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from nlens_video.core.layers import Float32

CRF = 28
NOISE = 0.02  # standard deviation, part of the full code range
WIDTHS = (480, 640, 1920, 3840)
_SEED = 20  # of the noise: every run sees the same


@dataclass(frozen=True, slots=True)
class Condition:
    """One thing that is done to a plate.

    Attributes:
        name: of its row.
        degrade: display-coded picture in [0, 1] (H, W, 3) to another, perhaps of another size.
    """

    name: str
    degrade: Callable[[Float32], Float32]


def picture_conditions() -> tuple[Condition, ...]:
    """The plate as it is first, then all that may happen to it."""
    return (
        Condition("as rendered", lambda rgb: rgb),
        Condition(f"H.264, crf {CRF}", through_h264),
        Condition(f"noise of {NOISE:.0%}", with_noise),
        *(Condition(f"{width} px wide", partial(scaled, width=width)) for width in WIDTHS),
    )


def with_noise(rgb: Float32, deviation: float = NOISE) -> Float32:
    """Add white Gaussian noise in display code; 8-bit codes in [0, 1] (H, W, 3) come out."""
    noise = np.random.default_rng(_SEED).normal(0, deviation, rgb.shape)
    return _eight_bit(np.asarray(rgb + noise, np.float32))


def scaled(rgb: Float32, width: int) -> Float32:
    """The picture at another width [px]; its height follows to the nearest pixel."""
    height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
    way = cv2.INTER_AREA if width < rgb.shape[1] else cv2.INTER_CUBIC
    resized = cv2.resize(rgb, (width, height), interpolation=way)
    return _eight_bit(np.asarray(resized, np.float32))


def through_h264(rgb: Float32, crf: int = CRF) -> Float32:
    """Encode a picture as a clip of one frame (libx264, 4:2:0, BT.709 limited) and decode it.

    One frame is the hardest case: no later one shares its bits.
    """
    import av

    height, width = rgb.shape[:2]
    even = np.pad(rgb, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    codes = np.ascontiguousarray(np.round(255 * np.clip(even, 0, 1)), dtype=np.uint8)
    clip = io.BytesIO()
    with av.open(clip, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = even.shape[1], even.shape[0], "yuv420p"
        # one thread: the bits must not depend on the machine's number of cores
        stream.options = {"crf": str(crf), "preset": "medium", "threads": "1"}
        frame = av.VideoFrame.from_ndarray(codes, "rgb24").reformat(
            format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
        )
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    clip.seek(0)
    with av.open(clip, "r") as container:
        decoded = next(container.decode(video=0)).to_ndarray(
            format="rgb24", src_colorspace="ITU709", src_color_range="MPEG"
        )
    return decoded[:height, :width].astype(np.float32) / np.float32(255)


def _eight_bit(rgb: Float32) -> Float32:
    return np.asarray(np.round(255 * np.clip(rgb, 0, 1)) / 255, dtype=np.float32)
