"""Scratch arrays of each thread, reused from frame to frame: page faults cost more than filling."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
import numpy.typing as npt


class _Kept(threading.local):
    """Buffers of one thread by name."""

    def __init__(self) -> None:
        self.buffers: dict[str, npt.NDArray[np.uint8]] = {}


_kept = _Kept()


def scratch(
    name: str, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float32
) -> npt.NDArray[Any]:
    """An array of any content, good until this thread asks for the same name again.

    Args:
        name: what it is for.
        shape: its shape; a buffer is kept as large as the largest asked for.
        dtype: its type.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    buffer = _kept.buffers.get(name)
    if buffer is None or buffer.size < size:
        _kept.buffers[name] = buffer = np.empty(size, np.uint8)
    return buffer[:size].view(dtype).reshape(shape)
