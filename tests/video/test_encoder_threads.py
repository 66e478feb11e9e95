"""Encoders' threads run beside all others."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from support import shots

from nlens_video.video.output.encoder_threads import ordinary_priority

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
