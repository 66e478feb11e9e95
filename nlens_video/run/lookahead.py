"""Reading frames ahead, as long as the lens is not fitted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Generic, TypeVar

from nlens_video.core.layers import Picture
from nlens_video.video.info import SourceFrame

FRAMES = 7  # a mean of eight frames has about a third of the noise of one

Item = TypeVar("Item")


class LookAhead(Generic[Item]):
    """An iterator that can read some of its items ahead.

    Args:
        items: frames and packets, in order.
    """

    def __init__(self, items: Iterator[Item]) -> None:
        self._items = items
        self._ahead: deque[Item] = deque()
        self._pictures: deque[Picture] = deque()  # of the frames in `_ahead`

    def iterate(self, wanted: Callable[[], bool]) -> Iterator[tuple[Item, tuple[Picture, ...]]]:
        """Each item with the pictures of the frames that follow it.

        Args:
            wanted: asked before each item whether to read ahead; once it is false, items that were
                read ahead come first and no more are read than are yielded.

        Yields:
            Item and up to `FRAMES` later pictures, none where the item is not a frame.
        """
        while True:
            ahead = wanted()
            if ahead:
                self._fill(FRAMES + 1)
            item = self._ahead.popleft() if self._ahead else next(self._items, None)
            if item is None:
                return
            following: tuple[Picture, ...] = ()
            if isinstance(item, SourceFrame):
                if self._pictures:
                    self._pictures.popleft()  # this frame's own
                following = tuple(islice(self._pictures, FRAMES)) if ahead else ()
            yield item, following

    def _fill(self, count: int) -> None:
        """Read until `count` frames are held or the source ends."""
        while len(self._pictures) < count:
            item = next(self._items, None)
            if item is None:
                return
            self._ahead.append(item)
            if isinstance(item, SourceFrame):
                self._pictures.append(item.picture)
