"""A frame of a stream as the graph takes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from nlens_video.core.layers import Picture


class StreamFrame(Protocol):
    """A frame of a source, as the graph needs it; see `video.source`."""

    @property
    def index(self) -> int:
        """Position in the stream."""
        ...

    @property
    def number(self) -> int:
        """The same with lost pictures counted, for files that lie beside the stream's."""
        ...

    @property
    def time_s(self) -> float:
        """Moment of the animation [s]."""
        ...

    @property
    def picture(self) -> Picture:
        """The plate; composited in place."""
        ...


@dataclass(frozen=True, slots=True)
class LoopFrame:
    """A frame of somebody's own loop."""

    index: int
    time_s: float
    picture: Picture

    @property
    def number(self) -> int:
        """Its index: nothing is lost in a loop."""
        return self.index
