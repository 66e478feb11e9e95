"""Conversion of frames of a source that changes its size or pixel format."""

from __future__ import annotations

import av

from nlens_video.video.pixels.pixel_formats import converted, resized
from nlens_video.video.pixels.sample_views import frame_tags


class Conform:
    """Brings every frame to the form of the first.

    Args:
        first: the source's first frame.

    Attributes:
        changed: frames that had another form [1].
    """

    def __init__(self, first: av.VideoFrame) -> None:
        self.changed = 0
        self._size = (first.width, first.height)
        self._format = first.format.name
        self._said = ""

    def __call__(self, frame: av.VideoFrame, index: int) -> av.VideoFrame:
        """The frame, or a copy in the first one's size and pixel format."""
        size, name = (frame.width, frame.height), frame.format.name
        if (size, name) == (self._size, self._format):
            return frame
        self.changed += 1
        self._said = self._said or f"from frame {index} on, {size[0]}x{size[1]} {name}"
        made = frame if size == self._size else resized(frame, *self._size)
        if name != self._format:
            made = converted(made, self._format, frame_tags(frame))
        made.pts, made.time_base, made.duration = frame.pts, frame.time_base, frame.duration
        return made

    def notes(self) -> tuple[str, ...]:
        """What was done, in words."""
        if not self.changed:
            return ()
        width, height = self._size
        return (
            f"{self.changed} frames had another form ({self._said}) and were converted to "
            f"{width}x{height} {self._format}",
        )
