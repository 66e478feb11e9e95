"""Looks for a frame of a stream that tells the lens: its first ones may be bars, or black noise."""

from __future__ import annotations

import math

from nlens_video.core.errors import LensFitError

STREAM_S = 5.0
"""How long a stream's frames may tell no lens [s]."""
_SPACING_S = 0.25  # from one frame that is looked at to the next, as the network takes its time [s]


class LensSearch:
    """Which frames are looked at until one tells the lens.

    Args:
        patience_s: how long frames after the first that was looked at may fail [s].

    Attributes:
        failure: of the last frame that was looked at, None once one told the lens.
        note: for the user, empty where the first frame that was looked at told it.
    """

    def __init__(self, patience_s: float = 0.0) -> None:
        self._patience_s = patience_s
        self._first_s, self._last_s = math.inf, -math.inf
        self.failure: LensFitError | None = None
        self.note = ""

    def passes_over(self, time_s: float) -> bool:
        """Whether a frame is not looked at, since one shortly before it told no lens."""
        return self.failure is not None and 0.0 <= time_s - self._last_s < _SPACING_S

    def failed(self, error: LensFitError, time_s: float) -> None:
        """A frame tells no lens.

        Raises:
            LensFitError: that error, where no further frame is looked at.
        """
        self._first_s = min(self._first_s, time_s)
        if self._patience_s <= time_s - self._first_s:
            raise error
        self.failure, self._last_s = error, time_s

    def found(self, time_s: float) -> None:
        """A frame tells the lens."""
        self.failure = None
        if math.isfinite(self._first_s):
            self.note = (
                f"no lens is found before {time_s - self._first_s:.2f} s of the stream; until then "
                "the object is not shown"
            )
