"""Arrays that each thread keeps from frame to frame for its intermediate results."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import numpy.typing as npt

_WINDOW = 1024
"""Requests of a thread after which it frees what they did not need."""
_SPARE = 2
"""A buffer is kept while it is at most so many times as large as the largest request."""
_LARGEST_KEPT = 32 << 20
"""What is larger is freed with its array: its page faults cost little beside what fills it [B]."""


class _Buffers(threading.local):
    """Buffers of one thread by name, and the largest request for each since the last check."""

    def __init__(self) -> None:
        self.by_name: dict[str, npt.NDArray[np.uint8]] = {}
        self.largest: dict[str, int] = {}
        self.requests = 0

    def free_unused(self) -> None:
        """Drop the buffers that were not asked for, and those that were needed in part only."""
        self.by_name = {
            name: buffer
            for name, buffer in self.by_name.items()
            if buffer.size <= _SPARE * self.largest.get(name, 0)
        }
        self.largest.clear()
        self.requests = 0


_buffers = _Buffers()


def scratch(
    name: str, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float32
) -> npt.NDArray[Any]:
    """An array of any content, good until this thread asks for the same name again.

    It is reused from frame to frame, for page faults cost more than filling; on photographs,
    whose arrays take gigabytes, it is not. A blur that was wider for a while does not keep its
    memory for ever: what a thread no longer needs, it frees.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size > _LARGEST_KEPT:
        _buffers.by_name.pop(name, None)
        return np.empty(shape, dtype)
    _buffers.requests += 1
    if _buffers.requests > _WINDOW:
        _buffers.free_unused()
    _buffers.largest[name] = max(size, _buffers.largest.get(name, 0))
    buffer = _buffers.by_name.get(name)
    if buffer is None or buffer.size < size:
        _buffers.by_name[name] = buffer = np.empty(size, np.uint8)
    return buffer[:size].view(dtype).reshape(shape)
