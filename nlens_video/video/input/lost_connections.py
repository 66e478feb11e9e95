"""Connections to addresses on which nothing arrives any more, or that break."""

from __future__ import annotations

import errno
import time
from collections import deque
from collections.abc import Iterable, Iterator

import av

from nlens_video.video.info import Packet

_SILENT_S = 0.5
"""Wait after which an error that may be a timeout is one: UDP reports it as an I/O error [s]."""
_LAST_READS = 8
"""Demuxers hand out what they hold of each stream before they report a timeout [1]."""
_BROKEN = frozenset((
    errno.EIO, errno.ENETDOWN, errno.ENETUNREACH, errno.ENETRESET, errno.EHOSTUNREACH,
    errno.ENOTCONN,
))  # fmt: skip
"""Errors of networks for which Python has no class of their own."""


def why_lost(spec: str, error: Exception, waited_s: float) -> str | None:
    """What happened to a connection, None where an error is not one of connections.

    Args:
        spec: the address; errors of files and devices have other causes.
        error: of opening or reading.
        waited_s: how long it took to come [s].
    """
    number = getattr(error, "errno", None)
    if "://" not in spec:
        return None
    if isinstance(error, TimeoutError) or (number == errno.EIO and waited_s >= _SILENT_S):
        return f"nothing arrived for {waited_s:.1f} s"
    if isinstance(error, ConnectionError) or number in _BROKEN:
        return f"the connection failed ({getattr(error, 'strerror', None) or error})"
    return None


def explain_lost(spec: str, lost: str) -> str:
    """Error message for a connection that was lost before its first frame.

    Args:
        spec: the address.
        lost: as `why_lost` says it.
    """
    longer = ", or raise its timeout" if "timeout=" in spec else ""
    return f"{spec}: no frame came: {lost}; check the address and what sends there{longer}"


class Reads:
    """Measures how long a source lets its reader wait, from its opening on."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._waits_s: deque[float] = deque(maxlen=_LAST_READS)

    def timed(self, packets: Iterable[Packet]) -> Iterator[Packet]:
        """The packets as they come; the time that the caller takes does not count."""
        try:
            for packet in packets:
                self._end()
                yield packet
                self._began = time.monotonic()
        except av.FFmpegError:
            self._end()
            raise

    @property
    def longest_s(self) -> float:
        """Longest wait for one of the last packets, or for the error in place of one [s]."""
        return max(self._waits_s, default=0.0)

    def _end(self) -> None:
        now = time.monotonic()
        self._waits_s.append(now - self._began)
        self._began = now
