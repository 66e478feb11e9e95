"""OpenCV's capture, with an object in its frames."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.compositor.compositor import Compositor
from nlens_video.core.settings import ObjectSettings

Image = npt.NDArray[Any]


class VideoCapture:
    """`cv2.VideoCapture` whose frames hold an object, for scripts that read frames by it.

    Methods, backends and properties are OpenCV's. A frame is composited when it is retrieved, so
    frames that are grabbed only cost what they cost there. Where a file is set to another position,
    the animation follows; a camera's animation follows the clock. Pixels that are not square are
    honoured where the backend tells of them, as OpenCV's FFmpeg does.

    Args:
        source: file, URL, pattern of pictures, GStreamer pipeline or number of a camera.
        glb: the animated object, as a `Compositor` takes it.
        api: OpenCV's backend, such as `cv2.CAP_FFMPEG`.
        params: OpenCV's parameters for opening, pairs of property and value.
        options: of a `Compositor`; the source tells its own `fps` and `pixel_aspect`, where it can.

    Raises:
        UsageError: an option is out of range, or contradicts another.
        LensFitError: the saved fit cannot be read.
    """

    def __init__(
        self,
        source: str | Path | int,
        glb: str | Path | ObjectSettings,
        *,
        api: int = cv2.CAP_ANY,
        params: Sequence[int] = (),
        **options: Any,  # noqa: ANN401  as Compositor declares them
    ) -> None:
        self._glb, self._options = glb, options
        self._capture = cv2.VideoCapture(_spec(source), api, list(params))
        self._start_s: float | None = None
        self._compositor = self._made()

    def _made(self) -> Compositor:
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        told = {"fps": rate} if np.isfinite(rate) and rate > 0.0 else {}
        told["pixel_aspect"] = self._pixel_aspect()
        return Compositor(self._glb, **{**told, **self._options})

    def _pixel_aspect(self) -> float:
        """Width of a pixel by its height, as retrieved: OpenCV turns pictures, not their ratio."""
        across, down = (
            self._capture.get(one) for one in (cv2.CAP_PROP_SAR_NUM, cv2.CAP_PROP_SAR_DEN)
        )
        if not (across > 0.0 and down > 0.0):
            return 1.0
        turned = self._capture.get(cv2.CAP_PROP_ORIENTATION_AUTO) and (
            self._capture.get(cv2.CAP_PROP_ORIENTATION_META) % 180
        )
        return down / across if turned else across / down

    @property
    def compositor(self) -> Compositor:
        """What composites the frames: its lens, plan and timings."""
        return self._compositor

    def open(
        self, source: str | Path | int, api: int = cv2.CAP_ANY, params: Sequence[int] = ()
    ) -> bool:
        """Open another source, with the same object; returns whether it is open."""
        self._compositor.close()
        opened: bool = self._capture.open(_spec(source), api, list(params))
        self._compositor, self._start_s = self._made(), None
        return opened

    def isOpened(self) -> bool:
        """Whether the source is open."""
        return bool(self._capture.isOpened())

    def grab(self) -> bool:
        """Go to the next frame; returns whether there is one."""
        return bool(self._capture.grab())

    def retrieve(self, image: Image | None = None, flag: int = 0) -> tuple[bool, Image | None]:
        """The frame that was grabbed, composited.

        Args:
            image: takes the result where it has its shape and type; else a new array does.
            flag: of OpenCV's backend.

        Returns:
            Whether there is one, and the frame (H, W, 3), BGR uint8, or as the backend gives it.

        Raises:
            NlensError: as `Compositor.process`.
        """
        found, frame = self._capture.retrieve(flag=flag)
        if not found:
            return False, None
        takes = image is not None and (image.shape, image.dtype) == (frame.shape, frame.dtype)
        out = image if takes else frame
        return True, self._compositor.process(frame, self._time_s(), out, self._number())

    def read(self, image: Image | None = None) -> tuple[bool, Image | None]:
        """Grab and retrieve the next frame; `(False, None)` after the last one."""
        return self.retrieve(image) if self.grab() else (False, None)

    def _time_s(self) -> float:
        """Moment of the grabbed frame in the animation [s]."""
        if self._capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0:
            return max(float(self._capture.get(cv2.CAP_PROP_POS_MSEC)), 0.0) / 1000.0
        now = time.monotonic()
        if self._start_s is None:
            self._start_s = now
        return now - self._start_s

    def _number(self) -> int | None:
        """Position of the grabbed frame in a file, None for a camera [1]."""
        if self._capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0:
            return max(round(self._capture.get(cv2.CAP_PROP_POS_FRAMES)) - 1, 0)
        return None

    def get(self, prop: int) -> float:
        """A property `cv2.CAP_PROP_…`; 0 where the backend has none."""
        return float(self._capture.get(prop))

    def set(self, prop: int, value: float) -> bool:
        """Set a property `cv2.CAP_PROP_…`; returns whether the backend took it."""
        return bool(self._capture.set(prop, value))

    def getBackendName(self) -> str:
        """Name of the backend that reads the source."""
        return str(self._capture.getBackendName())

    def setExceptionMode(self, enable: bool) -> None:  # noqa: FBT001  as OpenCV has it
        """Let OpenCV raise `cv2.error` where it would return False."""
        self._capture.setExceptionMode(enable)

    def getExceptionMode(self) -> bool:
        """Whether OpenCV raises `cv2.error`."""
        return bool(self._capture.getExceptionMode())

    def release(self) -> None:
        """Close the source, and free what composites; may be called again."""
        self._capture.release()
        self._compositor.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()


def _spec(source: str | Path | int) -> str | int:
    return source if isinstance(source, int) else str(source)
