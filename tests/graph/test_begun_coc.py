"""F on a run's first frame, begun while the rest of the run is prepared."""

import gc
import threading
import time
import weakref

import cv2
import numpy as np
import pytest

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import CocMap
from nlens_video.graph.base.begun_coc import BegunCoc
from nlens_video.graph.base.profiler import Profiler
from nlens_video.networks.device import choose
from nlens_video.networks.lazy import lazy_coc_estimator
from nlens_video.video.pixels.picture import ArrayPicture


def pictures(count):
    rng = np.random.default_rng(3)
    sharp = rng.integers(0, 255, (96, 160, 3)).astype(np.uint8)
    return tuple(ArrayPicture(cv2.GaussianBlur(sharp, (0, 0), 1.0 + at)) for at in range(count))


def begun_with(estimate, seen, profiler=None):
    coc = BegunCoc(estimate, profiler or Profiler())
    coc.begin(seen)
    return coc


class Estimator:
    """F that notes what it is asked and on which thread, and answers with a map of its own."""

    def __init__(self):
        self.asked = []
        self.threads = []
        self.asked_one = threading.Event()

    def __call__(self, picture, following):
        self.asked.append((picture, *following))
        self.threads.append(threading.current_thread())
        self.asked_one.set()
        made = np.full((2, 2), len(self.asked), np.float32)
        return CocMap(coc_px=made, sigma_px=made)


def test_first_pictures_are_estimated_once_on_another_thread():
    first, *later = pictures(3)
    estimate = Estimator()
    begun = begun_with(estimate, (first, *later))
    assert begun(first, later).coc_px[0, 0] == 1
    assert estimate.asked == [(first, *later)]
    assert estimate.threads[0] is not threading.current_thread()
    estimate.threads[0].join(10.0)
    assert not estimate.threads[0].is_alive()


@pytest.mark.parametrize("chosen", [[0], [0, 1], [1, 2], [0, 2, 1]])
def test_other_pictures_are_estimated_as_they_are_asked(chosen):
    seen = pictures(3)
    estimate = Estimator()
    begun = begun_with(estimate, seen)
    asked = [seen[at] for at in chosen]
    assert begun(asked[0], asked[1:]).coc_px[0, 0] == 2
    assert estimate.asked[1:] == [tuple(asked)]


def test_pictures_are_forgotten_once_they_are_asked():
    seen = pictures(2)
    estimate = Estimator()
    begun = begun_with(estimate, seen)
    begun(seen[0], seen[1:])
    begun(seen[0], seen[1:])  # another frame's lens may be found on the same pictures
    assert len(estimate.asked) == 2


def test_error_of_the_estimate_reaches_who_asks():
    def fails(picture, following):
        raise NlensError("no network")

    seen = pictures(2)
    begun = begun_with(fails, seen)
    with pytest.raises(NlensError, match="no network"):
        begun(seen[0], seen[1:])


def test_whole_time_of_the_estimate_counts_though_nobody_waits_for_it():
    done = threading.Event()

    def slow(picture, following):
        time.sleep(0.05)
        done.set()
        return CocMap(coc_px=np.ones((2, 2), np.float32), sigma_px=np.ones((2, 2), np.float32))

    seen, profiler = pictures(2), Profiler()
    begun = begun_with(slow, seen, profiler)
    assert done.wait(10.0)
    with profiler.timed(0, "estimate-coc"):
        begun(seen[0], seen[1:])
    assert profiler.close_frame(0, 0).nodes["estimate-coc"] >= 50.0


def test_what_nobody_will_ask_is_forgotten():
    seen = pictures(2)
    held = weakref.ref(seen[1])
    estimate = Estimator()
    begun = begun_with(estimate, seen)
    estimate.asked_one.wait(10.0)
    begun.forget()
    estimate.threads[0].join(10.0)
    estimate.asked.clear()
    del seen
    gc.collect()
    assert held() is None


def test_network_reads_the_same_ahead():
    seen = pictures(2)
    estimate = lazy_coc_estimator(1.0, choose("cpu"))
    ahead = begun_with(estimate, seen)(seen[0], seen[1:])
    alone = estimate(seen[0], seen[1:])
    np.testing.assert_array_equal(ahead.coc_px, alone.coc_px)
    np.testing.assert_array_equal(ahead.sigma_px, alone.sigma_px)
