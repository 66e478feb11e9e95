"""Encoders' threads run beside all others."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from support import shots

from nlens_video.video.input.source import open_source
from nlens_video.video.output.encoder_threads import open_in_background, ordinary_priority
from nlens_video.video.output.sink import open_sink

pytestmark = pytest.mark.skipif(
    not hasattr(os, "sched_setscheduler"), reason="only Linux says how threads are scheduled"
)


def policies():
    return {os.sched_getscheduler(int(task.name)) for task in Path("/proc/self/task").iterdir()}


def make_realtime():
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))


@pytest.mark.needs_root
def test_threads_that_an_encoder_makes_real_time_ones_become_ordinary():
    goes_on = threading.Event()
    try:
        with ordinary_priority():
            make_realtime()
            started = threading.Thread(target=goes_on.wait)  # inherits it
            started.start()
            assert os.SCHED_FIFO in policies()
        assert os.SCHED_FIFO not in policies()
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        goes_on.set()
        started.join()


@pytest.mark.needs_root
def test_process_that_is_a_real_time_one_by_the_users_wish_stays_one():
    try:
        make_realtime()
        with ordinary_priority():
            pass
        assert os.sched_getscheduler(0) == os.SCHED_FIFO
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.mark.parametrize("name", ["out.mkv", "out.avif"])
def test_run_that_writes_av1_has_ordinary_threads_and_says_nothing_of_the_encoder(tmp_path, name):
    plate = shots.write_video(tmp_path / "in.mp4", frames=3)
    glb, fit = shots.cube_glb(tmp_path / "anim.glb"), shots.fit_json(tmp_path / "fit.json")
    words = [str(plate), str(glb), str(tmp_path / name), "--fit", str(fit), "-q"]
    words += ["--codec", "av1"] if name.endswith("mkv") else ["--frame", "1"]
    code = (
        "import os; from nlens_video.cli.main import main\n"
        f"assert main({words!r}) == 0\n"
        "print({os.sched_getscheduler(int(t)) for t in os.listdir('/proc/self/task')})"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert run.stdout.strip() == "{0}"
    assert "Svt" not in run.stderr


def niceness():
    return {
        int(task.name): os.getpriority(os.PRIO_PROCESS, int(task.name))
        for task in Path("/proc/self/task").iterdir()
    }


def test_encoders_threads_give_way_to_all_others(tmp_path):
    plate = shots.write_video(tmp_path / "in.mp4", frames=3)
    before = niceness()
    with open_source(str(plate)) as source:
        decoding = niceness()
        with open_sink(str(tmp_path / "out.mp4"), source.info) as sink:
            encoding = niceness()
            for frame in source:
                sink.write(frame)
            sink.commit()
    own = before[threading.get_native_id()]
    started = {one: nice for one, nice in encoding.items() if one not in decoding}
    assert started and set(started.values()) == {min(own + 10, 19)}
    assert all(encoding[one] == nice for one, nice in before.items() if one in encoding)


def test_error_of_an_encoder_that_opens_in_the_background_reaches_the_caller():
    def refuse():
        raise ValueError("odd size")

    with pytest.raises(ValueError, match="odd size"):
        open_in_background(refuse)
