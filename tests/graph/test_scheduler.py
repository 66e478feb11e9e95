import itertools
import threading
import time
from contextlib import contextmanager

import pytest

from nlens_video.core import signals
from nlens_video.graph.scheduler import Worker, run_in_thread, run_workers


def step(function):
    @contextmanager
    def opened():
        yield function

    return opened


def lane_threads():
    return [t for t in threading.enumerate() if t.name in {"decode", "a", "b"}]


def test_items_pass_all_workers_in_order():
    lanes = [Worker("a", step(lambda x: x + 1)), Worker("b", step(lambda x: x * 10))]
    assert list(run_workers(range(50), lanes)) == [(x + 1) * 10 for x in range(50)]
    assert not lane_threads()


def test_oldest_droppable_items_make_room_for_new_ones():
    begun, go_on, dropped = threading.Event(), threading.Event(), []

    def slow(item):
        begun.set()
        assert go_on.wait(10)  # the lane holds the first item while all others come
        return item

    def source():
        yield 0
        assert begun.wait(10)
        yield from range(1, 8)
        go_on.set()

    def may_drop(item):
        if item % 2:
            dropped.append(item)
        return item % 2 == 1

    kept = list(run_workers(source(), [Worker("a", step(slow))], depth=5, may_drop=may_drop))
    assert dropped == [1, 3] and kept == [0, 2, 4, 5, 6, 7]


def test_endless_source_is_read_a_few_items_ahead_and_threads_end_on_close():
    made = []
    closed = []

    def endless():
        try:
            for number in itertools.count():
                made.append(number)
                yield number
        finally:
            closed.append(True)

    stream = run_workers(
        endless(), [Worker("a", step(lambda x: x)), Worker("b", step(lambda x: x))]
    )
    assert [next(stream) for _ in range(3)] == [0, 1, 2]
    time.sleep(0.3)
    # three queues of two, one item in the hands of each thread, three taken
    assert len(made) <= 3 + 3 * 2 + 3
    stream.close()
    assert not lane_threads()
    assert closed


def test_worker_opens_runs_and_closes_on_a_single_thread():
    seen = []

    @contextmanager
    def opened():
        seen.append(threading.current_thread())
        yield lambda x: (seen.append(threading.current_thread()), x)[1]
        seen.append(threading.current_thread())

    list(run_workers([1, 2], [Worker("a", opened)]))
    assert len(set(seen)) == 1 and seen[0].name == "a" and len(seen) == 4


@pytest.mark.parametrize("where", ["source", "lane", "opening"])
def test_exception_is_raised_after_the_items_before_it(where):
    def source():
        yield 1
        if where == "source":
            raise OSError("broken")
        yield 2

    def work(item):
        if where == "lane" and item == 2:
            raise OSError("broken")
        return item

    @contextmanager
    def opened():
        if where == "opening":
            raise OSError("broken")
        yield work

    got = []
    with pytest.raises(OSError, match="broken"):
        for item in run_workers(source(), [Worker("a", opened), Worker("b", step(lambda x: x))]):
            got.append(item)
    assert got == ([] if where == "opening" else [1])
    assert not lane_threads()


def test_workers_run_concurrently():
    meeting = threading.Barrier(2, timeout=30)

    def first(item):
        if item == 2:
            meeting.wait()  # with the other lane, which has item 1 in its hands
        return item

    def second(item):
        if item == 1:
            meeting.wait()
        return item

    assert list(run_workers([1, 2], [Worker("a", step(first)), Worker("b", step(second))])) == [
        1,
        2,
    ]


@pytest.fixture
def lost_interrupt():
    """A signal has arrived, but the exception that it raised was swallowed."""
    signals.requested.set()
    yield
    signals.requested.clear()


def test_blocking_call_ends_by_an_interrupt_whose_exception_was_lost(lost_interrupt):
    released = threading.Event()
    with pytest.raises(KeyboardInterrupt):
        run_in_thread(lambda: released.wait(20.0))
    released.set()


@pytest.mark.slow
def test_waiting_for_an_item_ends_by_an_interrupt_whose_exception_was_lost(lost_interrupt):
    released = threading.Event()

    def stalled():
        released.wait(20.0)
        yield 1

    with pytest.raises(KeyboardInterrupt):
        threading.Timer(1.0, released.set).start()
        next(run_workers(stalled(), []))
