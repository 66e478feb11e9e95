"""Defaults of libraries for the whole process, set before any of them is loaded."""

from __future__ import annotations

import ctypes
import os
import sys

_HEAPS = 1
_KEPT_BYTES = 1 << 25  # more is taken from the system for each array, and what is free given back
_MALLOC = (  # variable of the environment, number in glibc's malloc.h, value
    ("MALLOC_ARENA_MAX", -8, _HEAPS),
    ("MALLOC_MMAP_THRESHOLD_", -3, _KEPT_BYTES),
    ("MALLOC_TRIM_THRESHOLD_", -1, _KEPT_BYTES),
)


def set_library_defaults() -> None:
    """One thread for OpenBLAS, one heap for malloc that it keeps, unless the environment differs.

    Frames are shared out among threads of our own, and products of matrices are small: OpenBLAS'
    threads would spin between them. glibc would give each thread a heap, which keeps what that
    thread frees: 464 MB with the threads of decoder, lanes and kernels, where one heap takes 311.
    To give a frame's arrays back to the system, which clears each page that it hands out again,
    would take half the time that a run spends in it.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    for variable, number, value in _MALLOC:
        if variable in os.environ:
            continue
        os.environ[variable] = str(value)  # for the processes that this one starts
        if mallopt is not None:
            mallopt(number, value)
