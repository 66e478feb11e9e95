"""A few frames of foresight, for as long as the lens is not known."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import TypeVar

from nlens_video.frames import Picture
from nlens_video.video.info import SourceFrame

FRAMES = 7  # with the frame itself eight: the noise of their mean is a third of one's

Item = TypeVar("Item")


def with_following(
    items: Iterator[Item], wanted: Callable[[], bool]
) -> Iterator[tuple[Item, tuple[Picture, ...]]]:
    """Each item and the pictures of the frames that come after it.

    Args:
        items: frames and packets, in order.
        wanted: whether foresight is still of use; once it is not, no more than the item itself is
            read, and what was read ahead is handed out first.

    Yields:
        Item and up to `FRAMES` later pictures, none where the item is not a frame.
    """
    ahead: deque[Item] = deque()
    while True:
        if wanted():
            _fill(ahead, items)
        item = ahead.popleft() if ahead else next(items, None)
        if item is None:
            return
        following = _pictures(ahead) if _picture(item) is not None else ()
        yield item, following[:FRAMES]


def _fill(ahead: deque[Item], items: Iterator[Item]) -> None:
    """Read on until the item at the head has its frames, or the source ends."""
    while len(_pictures(ahead)) <= FRAMES:
        item = next(items, None)
        if item is None:
            return
        ahead.append(item)


def _pictures(items: deque[Item]) -> tuple[Picture, ...]:
    return tuple(picture for item in items if (picture := _picture(item)) is not None)


def _picture(item: object) -> Picture | None:
    return item.picture if isinstance(item, SourceFrame) else None
