"""Interlaced frames that come after whole ones."""

from __future__ import annotations

import av

from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.info import SourceInfo


class LateFields:
    """Tells of interlaced frames in a source that begins with whole ones.

    Args:
        info: the source.
    """

    def __init__(self, info: SourceInfo) -> None:
        self._told = info.interlaced
        self._count = self._first = 0

    def see(self, frame: av.VideoFrame, index: int) -> None:
        """Count a frame."""
        if frame.interlaced_frame and not self._told:
            self._first = self._first if self._count else index
            self._count += 1

    def notes(self) -> tuple[str, ...]:
        """A note on interlaced frames."""
        if not self._count:
            return ()
        return (
            Note(
                f"{self._count} frames from frame {self._first} on are interlaced, the first is "
                "not: they are composited and encoded as whole frames; deinterlace the plate "
                "first, as by ffmpeg -i IN -vf bwdif OUT",
                NoteKind.UNCERTAIN,
            ),
        )
