"""Arrays that a thread keeps from frame to frame."""

from __future__ import annotations

import threading
import weakref

import numpy as np

from nlens_video.kernels.scratch import scratch


def test_a_request_of_the_same_name_reuses_the_memory_and_another_name_does_not() -> None:
    first = scratch("one", (20, 30))
    assert first.shape == (20, 30)
    assert first.dtype == np.float32
    assert np.shares_memory(scratch("one", (10, 10), np.int32), first)
    assert not np.shares_memory(scratch("two", (20, 30)), first)


def test_each_thread_has_memory_of_its_own() -> None:
    ours, theirs = scratch("shared name", (8, 8)), []
    thread = threading.Thread(target=lambda: theirs.append(scratch("shared name", (8, 8))))
    thread.start()
    thread.join()
    assert not np.shares_memory(ours, theirs[0])


def test_memory_that_was_needed_for_a_while_is_freed_and_the_rest_stays() -> None:
    names = ("asked for in part", "not asked for")
    once = [weakref.ref(scratch(name, (1000, 1000)).base) for name in names]
    steady = weakref.ref(scratch("steady", (100, 100)).base)
    kept = scratch("kept by its user", (50, 50))
    kept[:] = 7.0
    for _ in range(3000):
        scratch("asked for in part", (10, 10))
        scratch("steady", (100, 99))
    assert [buffer() for buffer in once] == [None, None]
    assert steady() is not None
    assert (kept == 7.0).all()


def test_what_only_a_photograph_needs_is_freed_with_its_array() -> None:
    array = scratch("of a photograph", (4000, 3000))
    memory = weakref.ref(array if array.base is None else array.base)
    del array
    assert memory() is None
