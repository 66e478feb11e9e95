"""When a result begins: at its plate's own time, or at 0."""

from __future__ import annotations

from fractions import Fraction

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.info import CopiedStream, Packet, SourceFrame, SourceInfo
from nlens_video.video.times.part import cut_chapter

_TIMELESS = ("avi", "mxf", "gxf", "dv", "yuv4mpegpipe")
"""Containers whose streams all begin at 0: they count pictures and samples."""
_PADDED = ("avi",)
"""Of these, those that hold the first picture where sound begins earlier."""
_CLOCKED = ("mpegts", "mpeg", "vob", "svcd", "vcd", "dvd")
"""Containers whose times are those of a clock that runs on, such as a broadcaster's."""
SEEN_S = Fraction(1, 25)
"""Sound that is off by less is in sync [s]."""


class Start(Struct, frozen=True):
    """The time of a plate that is a result's time 0.

    Attributes:
        origin_s: that time [s].
    """

    origin_s: Fraction = Fraction(0)

    @classmethod
    def of(cls, info: SourceInfo, container: str) -> Start:
        """The start that suits a plate and a container.

        Args:
            info: the plate.
            container: FFmpeg's name of the muxer.
        """
        sound = (one.start_s for one in info.copied if one.start_s is not None)
        earliest = min((info.start_s, *sound))
        if container in _TIMELESS:
            # pictures begin with a whole frame: readers take what lies before them for frames
            frame_s = 1 / (info.average_rate or Fraction(25))
            ahead_s = info.start_s - earliest
            padded = container in _PADDED and ahead_s >= frame_s
            frames = round(ahead_s / frame_s) if padded else 0
            return cls(info.start_s - frames * frame_s)
        # containers hold no pictures before 0, or readers leave them out
        clocked = info.clocked and container not in _CLOCKED
        return cls(earliest) if clocked or info.start_s < 0 else cls()

    @property
    def notes(self) -> tuple[str, ...]:
        """A note where times differ from the plate's."""
        if abs(self.origin_s) < SEEN_S:
            return ()
        begins = (
            f"{float(self.origin_s):.3f} s of the plate's clock are left out"
            if self.origin_s > 0
            else f"the plate begins {-float(self.origin_s):.3f} s before that"
        )
        return (Note(f"times begin at 0: {begins}", NoteKind.INFORMATION),)

    def info(self, info: SourceInfo) -> SourceInfo:
        """The plate's properties in the result's time."""
        if not self.origin_s:
            return info
        chapters = (cut_chapter(one, self.origin_s, None) for one in info.chapters)
        copied = (
            one if one.start_s is None else replace(one, start_s=one.start_s - self.origin_s)
            for one in info.copied
        )
        ends_s = None if info.ends_s is None else info.ends_s - self.origin_s
        return replace(
            info, ends_s=ends_s, start_s=info.start_s - self.origin_s, copied=tuple(copied),
            chapters=tuple(one for one in chapters if one is not None),
        )  # fmt: skip

    def frame(self, frame: SourceFrame) -> SourceFrame:
        """A frame in the result's time."""
        ticks = round(self.origin_s / frame.time_base)
        return replace(frame, pts=frame.pts - ticks) if ticks else frame

    def shift(self, packet: Packet) -> None:
        """Put a packet into the result's time, in place."""
        if self.origin_s and packet.time_base:
            ticks = round(self.origin_s / packet.time_base)
            packet.dts = None if packet.dts is None else packet.dts - ticks
            packet.pts = None if packet.pts is None else packet.pts - ticks


def begins_at_zero(container: str) -> bool:
    """Whether all streams of a container begin at 0, whatever their times.

    Args:
        container: FFmpeg's name of the muxer.
    """
    return container in _TIMELESS


def counts_pictures(container: str) -> bool:
    """Whether a container shows pictures one after the other at its rate, whatever their times.

    AVI does not: FFmpeg writes empty frames where a time has no picture.

    Args:
        container: FFmpeg's name of the muxer.
    """
    return container in _TIMELESS and container not in _PADDED


def moved_sound(container: str, stream: CopiedStream) -> str:
    """What must be done to sound that a container would move; empty where it stays in sync.

    Args:
        container: FFmpeg's name of the muxer.
        stream: in the result's time.
    """
    start_s = stream.start_s
    if container not in _TIMELESS or start_s is None or stream.type != "audio":
        return ""
    # the first packet of a part may begin a packet later; those of PCM are of any length
    if start_s >= SEEN_S or (stream.cut and stream.codec.startswith("pcm_")):
        return f"silence is put before it, {container} has no place for its later start"
    if start_s <= -SEEN_S:
        return f"what comes before the pictures is left out, {container} has no place for it"
    return ""
