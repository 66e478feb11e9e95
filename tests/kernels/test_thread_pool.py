"""The thread pool: every item is processed once, on persistent threads, in any process."""

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from nlens_video.kernels import thread_pool
from nlens_video.kernels.thread_pool import parallel_for, processors

needs_affinity = pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity"), reason="this system binds no process to processors"
)


@pytest.mark.parametrize("workers", [None, 1, 2, 5])
def test_pool_processes_every_item_once(workers):
    done = []
    parallel_for(done.append, range(100), workers)
    assert sorted(done) == list(range(100))


def test_pool_returns_at_once_without_items():
    parallel_for(lambda _: pytest.fail("there is no item"), [])


def test_pool_creates_its_threads_once():
    parallel_for(lambda _: None, range(100), 3)
    before = threading.active_count()
    for _ in range(5):
        parallel_for(lambda _: None, range(100), 3)
    assert threading.active_count() == before


def test_error_of_any_thread_reaches_the_caller():
    def fail(item):
        raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item"):
        parallel_for(fail, range(9), 2)


def test_parallel_loops_can_be_nested():
    done = []
    parallel_for(lambda _: parallel_for(done.append, range(10), 4), range(10), 4)
    assert len(done) == 100


@needs_affinity
def test_pool_size_respects_the_processor_affinity():
    allowed = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert processors() == 1
    finally:
        os.sched_setaffinity(0, allowed)
    assert processors() == len(allowed)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_forked_child_can_use_the_pool():
    code = (
        "import os, sys\n"
        "from nlens_video.kernels.thread_pool import parallel_for\n"
        "done = []\n"
        "parallel_for(done.append, range(50), 3)\n"
        "child = os.fork()\n"
        "parallel_for(done.append, range(50), 3)\n"
        "status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) if child else 0\n"
        "sys.exit(status if len(done) == 100 else 1)\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", code]
    assert subprocess.run(command, timeout=30, check=False).returncode == 0


def test_loop_takes_no_helper_while_other_loops_hold_all_other_processors():
    inside, done = threading.Barrier(processors()), threading.Event()

    def hold(_):
        inside.wait(10)
        done.wait(10)

    holders = [
        threading.Thread(target=parallel_for, args=(hold, [0])) for _ in range(processors() - 1)
    ]
    for one in holders:
        one.start()
    inside.wait(10)
    seen = set()
    parallel_for(lambda _: (seen.add(threading.get_ident()), time.sleep(0.01)), range(9))
    done.set()
    for one in holders:
        one.join()
    assert seen == {threading.get_ident()}


def test_helpers_come_back_after_errors_and_nested_loops(monkeypatch):
    monkeypatch.setattr(thread_pool, "processors", lambda: max(2, processors()))  # else no helper

    def fail(item):
        parallel_for(lambda _: None, range(3))
        raise ValueError

    for _ in range(20):
        with pytest.raises(ValueError):
            parallel_for(fail, range(9))
    seen = set()
    parallel_for(lambda _: (seen.add(threading.get_ident()), time.sleep(0.01)), range(20))
    assert len(seen) > 1


def test_helpers_come_back_after_a_pool_that_takes_no_work(monkeypatch):
    monkeypatch.setattr(thread_pool, "processors", lambda: 2)
    ended = ThreadPoolExecutor(1)
    ended.shutdown()
    with monkeypatch.context() as broken:
        broken.setattr(thread_pool, "_pool", ended)
        for _ in range(3):
            with pytest.raises(RuntimeError):
                parallel_for(lambda _: None, range(9))
    seen = set()
    parallel_for(lambda _: (seen.add(threading.get_ident()), time.sleep(0.01)), range(20))
    assert len(seen) > 1
