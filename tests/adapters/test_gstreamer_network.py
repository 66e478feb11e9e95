"""GStreamer's element between cameras, servers, calls and windows, by docs/gstreamer.md."""

import os
import re
import signal
import subprocess
import time

import numpy as np
import pytest
from support.folders import ROOT
from support.programs import streams

pytestmark = [
    pytest.mark.slow,
    pytest.mark.needs_gl,
    pytest.mark.needs_programs("gst-launch-1.0"),
    pytest.mark.needs_gstreamer_python,
    pytest.mark.needs_gstreamer_network,
]
PAGE = (ROOT / "docs" / "gstreamer.md").read_text(encoding="utf-8")
CAMERA = "videotestsrc is-live=true pattern=ball ! video/x-raw,width=480,height=270,framerate=25/1"
SUPPORT = ROOT / "tests" / "support"
_ENOUGH = 3  # messages with timings, of which each 30 frames post one


def line_with(element):
    (line,) = re.findall(rf"^(?:gst-launch-1\.0|v4l2src) .*\b{element}\b.*", PAGE, re.M)
    return line.replace("v4l2src", CAMERA)


@pytest.fixture
def rtsp(environment, tmp_path):
    """The port of a server, and the file of what it is sent."""
    recording = tmp_path / "live.mkv"
    with subprocess.Popen(
        ["python", SUPPORT / "gstreamer_rtsp.py", recording], env=environment, text=True,
        stdout=subprocess.PIPE,
    ) as server:  # fmt: skip
        yield server.stdout.readline().strip(), recording
        server.kill()


def test_stream_of_an_rtsp_camera_reaches_an_rtsp_server(rtsp, environment, plates):
    port, recording = rtsp
    server = f"rtsp://127.0.0.1:{port}"
    line = line_with("rtspclientsink").replace("rtsp://camera/stream", f"{server}/camera")
    line = line.replace("rtsp://server/live", f"{server}/live")
    # It is interrupted once it runs: gst-launch waits for ever for the end of what has not begun.
    with subprocess.Popen(
        ["timeout", "-k", "5", "100", "bash", "-c", f"exec {line} -e -m"], text=True,
        cwd=plates("bt709").folder, env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    ) as run:  # fmt: skip
        said, timings = [], 0
        for one in run.stdout:
            said.append(one)
            timings += "nlens-timings" in one
            if "nlens-timings" in one and timings == _ENOUGH:
                run.send_signal(signal.SIGINT)
    assert timings >= _ENOUGH, "".join(said)
    (video,) = streams(recording)
    assert (video["codec_name"], video["width"], video["height"]) == ("h264", 480, 270)


def test_pictures_reach_the_other_side_of_a_call(environment, plates):
    run = subprocess.run(
        ["python", SUPPORT / "gstreamer_webrtc.py", line_with("webrtcbin name=rtc")],
        cwd=plates("bt709").folder, env=environment, capture_output=True, text=True, check=False,
        timeout=100,
    )  # fmt: skip
    assert run.returncode == 0 and int(run.stdout.split()[-1]) >= 20, run.stderr


@pytest.fixture
def screen():
    """The number of a screen without a monitor.

    `autovideosink` tries one sink after another. Without `-noreset` the server begins anew when the
    first one leaves, and turns away the next one that comes meanwhile.
    """
    reading, writing = os.pipe()
    with subprocess.Popen(
        ["Xvfb", "-displayfd", str(writing), "-nolisten", "tcp", "-noreset"], pass_fds=[writing],
        stderr=subprocess.DEVNULL,
    ) as server, os.fdopen(reading) as told:  # fmt: skip
        os.close(writing)
        yield told.readline().strip()
        server.send_signal(signal.SIGTERM)


def test_a_window_shows_the_pictures_of_a_camera(screen, environment, plates):
    line = line_with("autovideosink").replace("videotestsrc", "videotestsrc num-buffers=20")
    run = subprocess.run(
        ["bash", "-c", f"{line} -v"], cwd=plates("bt709").folder, capture_output=True, text=True,
        check=False, env={**environment, "DISPLAY": f":{screen}"}, timeout=100,
    )  # fmt: skip
    assert run.returncode == 0 and "Got EOS" in run.stdout, run.stderr
    assert re.search(r"GstXv?ImageSink", run.stdout), "a real window, no sink that throws away"


PIPEWIRE = """
pipewire &
until [ -S "$XDG_RUNTIME_DIR/pipewire-0" ]; do sleep 0.1; done
echo ready
exec wireplumber
"""


@pytest.fixture
def desktop(environment, tmp_path):
    """Environment of a user's session in which PipeWire runs."""
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    session = {**environment, "XDG_RUNTIME_DIR": str(runtime)}
    with subprocess.Popen(
        ["dbus-run-session", "--", "bash", "-c", PIPEWIRE], env=session, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
    ) as server:  # fmt: skip
        assert server.stdout.readline() == "ready\n"
        yield session
        os.killpg(server.pid, signal.SIGTERM)


def test_another_program_reads_the_virtual_camera(desktop, plates, tmp_path):
    folder, seen = plates("bt709").folder, tmp_path / "seen.raw"
    line = line_with("pipewiresink").replace("=ball", "=solid-color foreground-color=0xff808080")
    read = (
        "pipewiresrc target-object=nlens num-buffers=20 ! videoconvert "
        f"! video/x-raw,format=GRAY8 ! filesink location={seen}"
    )
    with subprocess.Popen(["bash", "-c", f"exec {line}"], cwd=folder, env=desktop) as camera:
        for _ in range(600):
            listed = subprocess.run(
                ["pw-cli", "list-objects", "Node"], env=desktop, capture_output=True, text=True,
                check=False,
            )  # fmt: skip
            if 'node.name = "nlens"' in listed.stdout:
                break
            assert camera.poll() is None
            time.sleep(0.1)
        run = subprocess.run(
            ["gst-launch-1.0", "-q", *read.split()], env=desktop, capture_output=True, text=True,
            check=False, timeout=60,
        )  # fmt: skip
        camera.send_signal(signal.SIGINT)
    assert run.returncode == 0, run.stderr
    luma = np.fromfile(seen, np.uint8).reshape(20, 270, 480)
    assert (np.ptp(luma, axis=(1, 2)) > 20).all(), "the object is in the grey picture"
