"""Defaults of libraries for the whole process, set before any of them is loaded."""

from __future__ import annotations

import ctypes
import os
import sys

_HEAPS = 1
_M_ARENA_MAX = -8  # of glibc's malloc.h


def set_library_defaults() -> None:
    """One thread for OpenBLAS, one heap for malloc, unless the environment says otherwise.

    Frames are shared out among threads of our own, and products of matrices are small: OpenBLAS'
    threads would spin between them. glibc would give each thread a heap, which keeps what that
    thread frees: 464 MB with the threads of decoder, lanes and kernels, where one heap takes 311.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if "MALLOC_ARENA_MAX" in os.environ or sys.platform != "linux":
        return
    os.environ["MALLOC_ARENA_MAX"] = str(_HEAPS)  # for the processes that this one starts
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    if mallopt is not None:
        mallopt(_M_ARENA_MAX, _HEAPS)
