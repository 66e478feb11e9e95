"""The last frames of a damaged file, which a decoder on several threads keeps to itself.

Each thread holds a frame. PyAV ends a flush at the first frame that cannot be decoded, and those
behind it are lost, with up to 15 good ones on a machine of many processors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import av

from nlens_video.core.errors import InputError
from nlens_video.video.info import Packet
from nlens_video.video.input.open import (
    DECODER,
    InputHints,
    decoder_of,
    open_container,
    video_stream,
)


class Delivery:
    """Whether a decoder has given a frame for the last packet, by their times."""

    def __init__(self) -> None:
        self.shown: int | None = None
        self._sent: int | None = None

    def send(self, packet: Packet) -> None:
        """Note a packet of which a frame is expected."""
        if packet.pts is not None and not packet.is_discard:
            self._sent = packet.pts if self._sent is None else max(self._sent, packet.pts)

    def show(self, frame: av.VideoFrame) -> None:
        """Note a decoded frame."""
        if frame.pts is not None:
            self.shown = frame.pts if self.shown is None else max(self.shown, frame.pts)

    @property
    def complete(self) -> bool:
        """Whether it has, or the packets have no times."""
        return self._sent is None or (self.shown is not None and self.shown >= self._sent)


def frames_after(
    spec: str, hints: InputHints, pts: int | None, damaged: Callable[[int | None], None]
) -> Iterator[av.VideoFrame]:
    """Decode a file's frames after one, from a key frame before it, on a single thread.

    Args:
        spec: the file or sequence.
        hints: the user's options.
        pts: time stamp of the last frame that is known, None for all frames [ticks].
        damaged: called with the time stamp of each packet after it that cannot be decoded [ticks].
    """
    try:
        container, _ = open_container(spec, hints)
    except InputError:
        return  # it is gone
    with container:
        stream = video_stream(container, spec)
        decoder = decoder_of(stream)
        decoder.thread_count = 1
        decoder.options = DECODER
        try:
            if pts is not None:
                container.seek(pts, stream=stream)
            for packet in container.demux(stream):
                try:
                    frames = decoder.decode(packet)
                except av.FFmpegError:
                    if packet.pts is not None and (pts is None or packet.pts > pts):
                        damaged(packet.pts)
                    continue
                for frame in frames:
                    if frame.pts is not None and (pts is None or frame.pts > pts):
                        yield frame
        except av.FFmpegError:
            return  # the file ends amid a packet
