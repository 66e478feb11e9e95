"""H.264 files of drawn clips: sRGB code values, tagged BT.709 of limited range."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import av
import numpy as np
import numpy.typing as npt

Codes = npt.NDArray[np.floating[Any]]
Array = npt.NDArray[np.float32]


def write_clip_file(path: Path, frames: Iterable[Codes], rate: int, crf: int) -> None:
    """Encode a clip, the same bits on any number of processors.

    Args:
        path: of the file to write.
        frames: code values (H, W, 3), clipped to 0 to 1; of even height and width.
        rate: frames a second.
        crf: constant rate factor of x264, 0 to 51.

    Raises:
        ValueError: there is no frame.
    """
    with av.open(str(path), "w") as container:
        stream: Any = None
        for codes in frames:
            if stream is None:
                options = {"crf": str(crf), "threads": "1"}
                stream = container.add_stream("libx264", rate, options=options)
                stream.height, stream.width = codes.shape[:2]
                stream.pix_fmt = "yuv420p"
                stream.colorspace, stream.color_range = 1, 1
            rounded = np.uint8(255 * np.clip(codes, 0, 1) + 0.5)
            frame = av.VideoFrame.from_ndarray(rounded, "rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            container.mux(stream.encode(frame))
        if stream is None:
            raise ValueError(f"{path}: a clip needs a frame")
        container.mux(stream.encode())


def read_clip_file(path: Path) -> Iterator[Array]:
    """Code values of each frame of such a file (H, W, 3), 0 to 1."""
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            codes = frame.to_ndarray(
                format="rgb24", src_colorspace="ITU709", src_color_range="MPEG"
            )
            yield codes.astype(np.float32) / np.float32(255)
