"""Interrupts that come at a bad moment."""

import signal
import subprocess
import sys

import pytest

from nlens_video.core import signals

IMPORTS = """
import os, signal, sys, time
from nlens_video.core import signals
sys.path.insert(0, {folder!r})
try:
    with signals.interruptible():
        import interrupted_module
        print("imported", interrupted_module.READY)
        time.sleep(30)
except KeyboardInterrupt:
    print("interrupted")
"""
STARTS = """
import os, signal, sys, time
from concurrent.futures import ThreadPoolExecutor
from nlens_video.core import signals

def look(frame, event, _):
    names = frame.f_code.co_name, frame.f_back and frame.f_back.f_code.co_name
    if event == "call" and names == ("wait", "start"):
        sys.setprofile(None)
        os.kill(os.getpid(), signal.SIGINT)

pool = ThreadPoolExecutor(1)
try:
    with signals.interruptible():
        sys.setprofile(look)
        future = pool.submit(int)
        print("started", future.result())
        time.sleep(30)
except KeyboardInterrupt:
    print("interrupted")
"""
FOREVER = """
import os, signal, sys, time
from nlens_video.core import signals
sys.path.insert(0, {folder!r})
signals._LATEST = 5
try:
    with signals.interruptible():
        import endless_module
except KeyboardInterrupt:
    print("interrupted")
"""
COMPLETE = """
import os, signal
from nlens_video.core import signals
with signals.interruptible(ends=True):
    signals.complete()
    os.kill(os.getpid(), signal.{name})
    print("told", flush=True)
os.kill(os.getpid(), signal.{name})
print("ended")
"""
pytestmark = pytest.mark.skipif(
    not hasattr(signal, "SIGALRM"), reason="interrupts are delayed by SIGALRM, which Windows lacks"
)


def told(code):
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    return run.stdout, run.returncode


def test_interrupt_waits_until_a_module_is_imported(tmp_path):
    (tmp_path / "interrupted_module.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nREADY = 1\n"
    )
    assert told(IMPORTS.format(folder=str(tmp_path))) == ("imported 1\ninterrupted\n", 0)


def test_interrupt_waits_until_a_thread_is_started_and_the_program_ends():
    assert told(STARTS) == ("started 0\ninterrupted\n", 0)


def test_interrupt_of_an_import_that_does_not_end_comes_none_the_less(tmp_path):
    (tmp_path / "endless_module.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(30)\n"
    )
    assert told(FOREVER.format(folder=str(tmp_path))) == ("interrupted\n", 0)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signal_after_all_is_written_changes_nothing(name):
    assert told(COMPLETE.format(name=name)) == ("told\nended\n", 0)


@pytest.mark.parametrize("hangup", [signal.SIG_DFL, signal.SIG_IGN])
def test_handlers_of_a_program_that_goes_on_are_restored(hangup):
    """A hangup that is ignored, as below nohup, stays so."""
    earlier = signal.signal(signal.SIGHUP, hangup)
    try:
        before = {number: signal.getsignal(number) for number in signals.ENDING}
        with signals.interruptible():
            signals.complete()
            taken = {number for number, own in before.items() if own is not signal.SIG_IGN}
            for number in signals.ENDING:
                own = signals.handler if number in taken else signal.SIG_IGN
                assert signal.getsignal(number) is own
        assert {number: signal.getsignal(number) for number in signals.ENDING} == before
        assert (signal.SIGHUP in taken) == (hangup is signal.SIG_DFL)
    finally:
        signal.signal(signal.SIGHUP, earlier)
