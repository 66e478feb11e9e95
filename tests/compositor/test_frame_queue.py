"""Frames handed over to be composited, and taken later; frames in memory that processes share."""

import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.shared_memory import SharedMemory

import numpy as np
import pytest
from support import shots

from nlens_video import Compositor, FrameQueue
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.lens_fit import LensFit

pytestmark = pytest.mark.needs_gl
FIT = LensFit(slope=shots.SLOPE, intercept=shots.INTERCEPT, width=shots.WIDTH, height=shots.HEIGHT)


@pytest.fixture
def lens(tmp_path):
    glb = shots.cube_glb(tmp_path / "anim.glb", end=(0.3, 0.0, -2.6), seconds=0.5)
    with Compositor(glb, preset="draft", fit=FIT, fps=25) as compositor:
        yield compositor


def bgr():
    return np.ascontiguousarray(shots.plate()[..., ::-1])


def test_results_come_in_order_and_are_those_of_process(lens):
    expected = [lens.process(bgr(), number / 25) for number in range(6)]
    with FrameQueue(lens, 2) as queue:
        made, last = [], None
        for number in range(6):
            if len(queue) == 2:
                made.append(queue.result())
            queue.submit(bgr(), number / 25)
        last = [queue.result(), queue.result()]
    for one, other in zip([*made, *last], expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_full_queue_makes_the_producer_wait(lens):
    with FrameQueue(lens, 2) as queue:
        producer = threading.Thread(target=lambda: [queue.submit(bgr(), 0.0) for _ in range(4)])
        producer.start()
        until = time.monotonic() + 30
        while len(queue) < 2 and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(0.1)
        assert producer.is_alive() and len(queue) == 2
        assert all(queue.result() is not None for _ in range(4))
        producer.join(30)
        assert not producer.is_alive() and queue.dropped == 0


def test_camera_drops_the_oldest_waiting_frame(lens):
    lens.process(bgr(), 0.0)
    busy = threading.Event()
    blocked = threading.Thread(target=lambda: lens._thread.call(lambda: busy.wait(5)))
    blocked.start()
    with FrameQueue(lens, 2, on_full="drop") as queue:
        for number in range(6):
            queue.submit(bgr(), number / 25)
        assert queue.dropped == 4 and len(queue) == 2
        busy.set()
        first, last = queue.result(), queue.result()
    blocked.join()
    np.testing.assert_array_equal(first, lens.process(bgr(), 0.0))
    np.testing.assert_array_equal(last, lens.process(bgr(), 5 / 25))


def test_frames_that_a_camera_drops_take_their_time_with_them(lens):
    expected = lens.process(bgr(), 5 / 25)
    busy = threading.Event()
    blocked = threading.Thread(target=lambda: lens._thread.call(lambda: busy.wait(5)))
    blocked.start()
    with FrameQueue(lens, 2, on_full="drop") as queue:
        for _ in range(6):
            queue.submit(bgr())
        busy.set()
        queue.result()
        np.testing.assert_array_equal(queue.result(), expected)
    blocked.join()


def test_consumer_of_a_frame_that_is_left_out_gets_the_next(lens):
    with FrameQueue(lens, 1, on_full="drop") as queue, ThreadPoolExecutor(1) as other:
        busy = threading.Event()
        queue._worker.submit(busy.wait, 30)
        queue.submit(bgr(), 0.0)
        taken = other.submit(queue.result)
        time.sleep(0.1)  # until it waits for that frame
        queue.submit(bgr(), 0.2)
        busy.set()
        np.testing.assert_array_equal(taken.result(30), lens.process(bgr(), 0.2))
        assert queue.dropped == 1 and len(queue) == 0


def test_camera_goes_on_where_nobody_takes_results(lens):
    with FrameQueue(lens, 2, on_full="drop") as queue, ThreadPoolExecutor(1) as camera:
        for number in range(5):
            camera.submit(queue.submit, bgr(), number / 25).result(30)
            until = time.monotonic() + 30
            while not all(one.done() for one in queue._pending) and time.monotonic() < until:
                time.sleep(0.01)
        assert queue.dropped == 3 and len(queue) == 2
        for number in (3, 4):
            np.testing.assert_array_equal(queue.result(), lens.process(bgr(), number / 25))


def test_several_threads_may_take_results(lens):
    def take_all():
        taken = []
        while (result := queue.result()) is not None:
            taken.append(result)
        return taken

    with ThreadPoolExecutor(2) as takers:
        with FrameQueue(lens, 8) as queue:
            taken = [takers.submit(take_all) for _ in range(2)]
            for _ in range(30):
                queue.submit(bgr(), 0.0)
        assert sum(len(one.result(60)) for one in taken) == 30


def test_time_to_wait_is_that_of_the_frame_and_of_its_result_together(lens):
    with FrameQueue(lens) as queue:
        busy = threading.Event()
        queue._worker.submit(busy.wait, 30)
        sender = threading.Timer(0.6, queue.submit, [bgr(), 0.0])
        sender.start()
        begin = time.monotonic()
        assert queue.result(0.9) is None
        assert time.monotonic() - begin < 1.3
        sender.join()
        busy.set()
        assert queue.result() is not None  # the frame that came too late is not lost


def test_result_is_written_where_it_is_asked_for(lens):
    frame = bgr()
    with FrameQueue(lens) as queue:
        queue.submit(frame, 0.0, frame)
        assert queue.result() is frame and not np.array_equal(frame, bgr())


def test_error_of_a_frame_comes_in_its_place(lens):
    with FrameQueue(lens) as queue:
        queue.submit(bgr().astype(np.float64))
        queue.submit(bgr(), 0.0)
        with pytest.raises(InputError, match="float64"):
            queue.result()
        np.testing.assert_array_equal(queue.result(), lens.process(bgr(), 0.0))


def test_waiting_ends_by_its_time_or_by_closing(lens):
    queue = FrameQueue(lens)
    assert queue.result(0.05) is None
    closer = threading.Timer(0.2, queue.close)
    closer.start()
    assert queue.result() is None
    closer.join()
    with pytest.raises(UsageError, match="queue is closed"):
        queue.submit(bgr())


@pytest.mark.parametrize(
    ("size", "on_full"), [(0, "wait"), (1.5, "wait"), (None, "wait"), (2, "skip")]
)
def test_settings_out_of_range_are_refused(lens, size, on_full):
    with pytest.raises(UsageError, match="expected"):
        FrameQueue(lens, size, on_full=on_full)


READER = """
import sys
import numpy as np
from multiprocessing.resource_tracker import unregister
from multiprocessing.shared_memory import SharedMemory
memory = SharedMemory(sys.argv[1])
unregister(memory._name, "shared_memory")  # its maker removes it
print(int(np.frombuffer(memory.buf, np.uint8, {size}).astype(np.uint64).sum()))
memory.close()
"""


def test_frame_in_shared_memory_is_composited_where_another_process_sees_it(lens):
    plain = bgr()
    memory = SharedMemory(create=True, size=plain.nbytes)
    try:
        frame = np.ndarray(plain.shape, plain.dtype, memory.buf)
        frame[...] = plain
        assert lens.process(frame, 0.0, frame) is frame
        run = subprocess.run(
            [sys.executable, "-c", READER.format(size=plain.nbytes), memory.name],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        assert int(run.stdout) == int(lens.process(plain, 0.0).astype(np.uint64).sum())
        lens.process(plain, 0.0)  # the last picture shown is no longer the shared one
        del frame
    finally:
        memory.close()
        memory.unlink()


def test_queue_composites_frames_in_shared_memory_where_they_lie(lens):
    memory = SharedMemory(create=True, size=2 * bgr().nbytes)
    try:
        frames = np.ndarray((2, *bgr().shape), np.uint8, memory.buf)
        frames[...] = bgr()
        with FrameQueue(lens, 2) as queue:
            for number in range(2):
                queue.submit(frames[number], number / 25, frames[number])
            made = [queue.result() for _ in range(2)]
        assert all(np.shares_memory(one, frames) for one in made)
        for number in range(2):
            np.testing.assert_array_equal(frames[number], lens.process(bgr(), number / 25))
        del frames, made
    finally:
        memory.close()
        memory.unlink()
