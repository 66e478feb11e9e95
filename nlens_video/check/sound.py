"""Audio of two sources compared packet by packet, in memory that does not grow with them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from zlib import crc32

from nlens_video.video.info import Packet

LIMIT_S = 0.04
"""Shift of sound against picture that people begin to notice (EBU R37)."""


@dataclass(slots=True)
class Sound:
    """One audio stream of one source, in seconds after that source's first frame."""

    start_s: float | None = None
    end_s: float = 0.0
    packets: int = 0
    waiting: deque[tuple[float, int]] = field(default_factory=deque)


@dataclass(slots=True)
class SoundPair:
    """An audio stream of the plate and its counterpart in the result.

    Attributes:
        codecs: FFmpeg's names, plate and result.
        plate: what came from the plate.
        result: what came from the result.
        off_s: largest shift of a packet against its counterpart, signed [s].
        changed: packets whose bytes differ, where both have one codec [1].
    """

    codecs: tuple[str, str]
    plate: Sound = field(default_factory=Sound)
    result: Sound = field(default_factory=Sound)
    off_s: float = 0.0
    changed: int = 0

    def take(self, packet: Packet, first_s: float, *, from_plate: bool) -> None:
        """Count one packet."""
        ticks = packet.pts if packet.pts is not None else packet.dts
        if ticks is None or packet.time_base is None:
            return
        sound = self.plate if from_plate else self.result
        moment = float(ticks * packet.time_base) - first_s
        sound.start_s = moment if sound.start_s is None else min(sound.start_s, moment)
        sound.end_s = max(sound.end_s, moment + float((packet.duration or 0) * packet.time_base))
        sound.packets += 1
        if self.codecs[0] != self.codecs[1]:
            return
        sound.waiting.append((moment, crc32(bytes(packet))))
        while self.plate.waiting and self.result.waiting:
            ours, theirs = self.result.waiting.popleft(), self.plate.waiting.popleft()
            self.changed += ours[1] != theirs[1]
            self.off_s = max(self.off_s, ours[0] - theirs[0], key=abs)

    @property
    def shifts_s(self) -> tuple[float, float, float]:
        """How much later the result's sound starts, ends, and at most lies [s]."""
        start = (self.result.start_s or 0.0) - (self.plate.start_s or 0.0)
        end = self.result.end_s - self.plate.end_s
        same = self.codecs[0] == self.codecs[1] and not self.changed
        return start, end, self.off_s if same else 0.0
