"""A few frames of foresight, for as long as the lens is not known."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Generic, TypeVar

from nlens_video.core.layers import Picture
from nlens_video.video.info import SourceFrame

FRAMES = 7  # with the frame itself eight: the noise of their mean is a third of one's

Item = TypeVar("Item")


class LookAhead(Generic[Item]):
    """Items of a source, some of them read before their turn.

    Args:
        items: frames and packets, in order.
    """

    def __init__(self, items: Iterator[Item]) -> None:
        self._items = items
        self._ahead: deque[Item] = deque()
        self._pictures: deque[Picture] = deque()  # of the frames among them

    def iterate(self, wanted: Callable[[], bool]) -> Iterator[tuple[Item, tuple[Picture, ...]]]:
        """Each item and the pictures of the frames that come after it.

        Args:
            wanted: whether foresight is still of use; once it is not, no more than the item itself
                is read, and what was read ahead is handed out first.

        Yields:
            Item and up to `FRAMES` later pictures, none where the item is not a frame.
        """
        while True:
            foreseen = wanted()
            if foreseen:
                self._fill(FRAMES + 1)
            item = self._ahead.popleft() if self._ahead else next(self._items, None)
            if item is None:
                return
            following: tuple[Picture, ...] = ()
            if isinstance(item, SourceFrame):
                if self._pictures:
                    self._pictures.popleft()  # its own
                following = tuple(islice(self._pictures, FRAMES)) if foreseen else ()
            yield item, following

    def _fill(self, count: int) -> None:
        """Read on until so many frames are held, or the source ends."""
        while len(self._pictures) < count:
            item = next(self._items, None)
            if item is None:
                return
            self._ahead.append(item)
            if isinstance(item, SourceFrame):
                self._pictures.append(item.picture)
