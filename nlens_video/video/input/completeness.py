"""Detection of truncated files: the stated duration against the times of the packets."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import av
import av.container
from av.stream import Stream

from nlens_video.video.info import Packet, is_cover

_SHARE = Fraction(1, 20)
"""Of its length a file may lack and still count as whole: lengths are often rounded [1]."""
_SLACK_S = Fraction(1, 5)


class Completeness:
    """Compares how long a file says it is with how far its packets reach.

    By time and not by counts of frames: edit lists, variable rates and a later start make counts
    differ in files that are whole. All streams count, for any of them may be the longest.

    Args:
        container: the file.
        streams: those whose packets are read.
    """

    def __init__(self, container: av.container.InputContainer, streams: Sequence[Stream]) -> None:
        timed = [one for one in streams if one.type != "attachment" and not is_cover(one)]
        ends = [_end_s(one) for one in timed]
        known = [end for end in ends if end is not None]
        whole = container.duration
        self._stated_s = Fraction(whole, av.time_base) if whole else None
        if len(known) == len(timed):
            self._stated_s = max(known)
        self._last_s: dict[int, Fraction] = {}
        self._reached_s = self._longest_s = Fraction(0)

    def saw(self, packet: Packet) -> None:
        """Count a packet."""
        if packet.pts is None or not packet.time_base:
            return
        start_s = packet.pts * Fraction(packet.time_base)
        last_s = self._last_s.get(packet.stream.index, start_s)
        self._longest_s = max(self._longest_s, start_s - last_s)
        self._last_s[packet.stream.index] = max(last_s, start_s)
        end_s = start_s + (packet.duration or 0) * Fraction(packet.time_base)
        self._reached_s = max(self._reached_s, end_s)

    def notes(self) -> tuple[str, ...]:
        """A note where the file ended early; call once its end was reached."""
        if self._stated_s is None:
            return ()
        slack_s = max(self._stated_s * _SHARE, 2 * self._longest_s, _SLACK_S)
        if self._reached_s >= self._stated_s - slack_s:
            return ()
        return (
            f"the source says that it lasts {float(self._stated_s):.2f} s and ends after "
            f"{float(self._reached_s):.2f} s: it is cut short or damaged",
        )


def _end_s(stream: Stream) -> Fraction | None:
    """When a stream ends as its header has it [s]."""
    if stream.duration is None or stream.time_base is None:
        return None
    return ((stream.start_time or 0) + stream.duration) * Fraction(stream.time_base)
