"""Audio of a result against its plate's, packet by packet.

A few numbers a packet are kept.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from zlib import crc32

from nlens_video.check.verdict import Finding, at
from nlens_video.video.info import Packet

LIMIT_S = 0.04
"""Shift of sound against picture that viewers begin to notice (EBU R37)."""
_MOSTLY = 0.5  # share of the packets that are the plate's, unless they are encoded anew


@dataclass(slots=True)
class Sound:
    """One audio stream of one source, in seconds after that source's first frame.

    Attributes:
        start_s: of its first packet, None before it [s].
        end_s: of its last packet [s].
        times: of its packets [s].
        sums: their checksums.
    """

    start_s: float | None = None
    end_s: float = 0.0
    times: array[float] = field(default_factory=lambda: array("d"))
    sums: array[int] = field(default_factory=lambda: array("I"))

    def part(self, first: int, end: int) -> tuple[float, float]:
        """Begin and end of some of its packets [s]."""
        return self.times[first], self.times[end] if end < len(self.times) else self.end_s


@dataclass(slots=True)
class SoundPair:
    """An audio stream of the plate and its counterpart in the result.

    Attributes:
        codecs: FFmpeg's names, plate and result.
        plate: of the plate.
        result: of the result.
    """

    codecs: tuple[str, str]
    plate: Sound = field(default_factory=Sound)
    result: Sound = field(default_factory=Sound)

    def add(self, packet: Packet, first_s: float, *, from_plate: bool) -> None:
        """Count one packet."""
        ticks = packet.pts if packet.pts is not None else packet.dts
        if ticks is None or packet.time_base is None:
            return
        sound = self.plate if from_plate else self.result
        moment = float(ticks * packet.time_base) - first_s
        sound.start_s = moment if sound.start_s is None else min(sound.start_s, moment)
        sound.end_s = max(sound.end_s, moment + float((packet.duration or 0) * packet.time_base))
        sound.times.append(moment)
        sound.sums.append(crc32(bytes(packet)))

    @property
    def alike(self) -> tuple[int, int]:
        """Packets from the start, and those before the end, that both have byte by byte."""
        ours, theirs = self.result.sums, self.plate.sums
        most = min(len(ours), len(theirs))
        if self.codecs[0] != self.codecs[1]:
            return 0, 0
        first = next((at for at in range(most) if ours[at] != theirs[at]), most)
        rest = most - first
        last = next((at for at in range(rest) if ours[-1 - at] != theirs[-1 - at]), rest)
        return first, last

    @property
    def copied(self) -> bool:
        """Whether the result's packets are the plate's, but for a stretch at most."""
        most = min(len(self.plate.sums), len(self.result.sums))
        return self.codecs[0] == self.codecs[1] and sum(self.alike) >= _MOSTLY * most

    @property
    def shifts_s(self) -> tuple[float, float, float]:
        """Delay of the result's sound at its start, at its end, and the largest one [s]."""
        start = (self.result.start_s or 0.0) - (self.plate.start_s or 0.0)
        end = self.result.end_s - self.plate.end_s
        return start, end, self._largest_shift_s() if self.copied else 0.0

    def _largest_shift_s(self) -> float:
        first, last = self.alike
        ours, theirs = self.result.times, self.plate.times
        pairs = (*range(first), *range(-last, 0))
        return max((ours[place] - theirs[place] for place in pairs), default=0.0, key=abs)


def judge_sound(pairs: list[SoundPair], missing: int) -> list[Finding]:
    """Sound that is missing, shifted, of another length, or changed in a stretch.

    Args:
        pairs: the streams that both have.
        missing: number of those that the result lacks.
    """
    found = []
    if missing:
        found.append(at("sound", None, missing, f"{missing} audio stream(s) of the input missing"))
    for number, pair in enumerate(pairs):
        start, end, most = pair.shifts_s
        for shift, words in ((start, "starts"), (end, "ends"), (most, "lies at most")):
            if abs(shift) > LIMIT_S:
                direction = "late" if shift > 0 else "early"
                text = f"audio {number} {words} {1e3 * abs(shift):.0f} ms {direction}"
                limit = f"(limit {1e3 * LIMIT_S:.0f} ms)"
                found.append(at("sound", None, shift, f"{text} {limit}"))
        found += _judge_stretch(number, pair)
    return found


def sound_notes(pairs: list[SoundPair]) -> list[str]:
    """What is not judged of the sound."""
    return [
        f"audio {number} is not the plate's byte by byte, but encoded anew or exchanged: only its "
        "start and its end are compared"
        for number, pair in enumerate(pairs)
        if not pair.copied
    ]


def _judge_stretch(number: int, pair: SoundPair) -> list[Finding]:
    """Packets in the middle that are lost, added or changed while all others are the plate's."""
    first, last = pair.alike
    lost, added = (len(one.sums) - first - last for one in (pair.plate, pair.result))
    shorter = not (first and last and lost + added)  # which start and end tell
    if not pair.copied or (shorter and not (lost and added)):
        return []
    begin_s, end_s = pair.plate.part(first, first + lost)
    if not lost:
        words = f"has {added} packet(s) at {begin_s:.2f} s that the plate lacks"
    elif not added:
        words = f"lacks {lost} of the plate's packets from {begin_s:.2f} to {end_s:.2f} s"
    else:
        words = f"has other packets than the plate from {begin_s:.2f} to {end_s:.2f} s"
    return [at("sound", None, float(lost - added), f"audio {number} {words}")]
