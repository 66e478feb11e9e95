"""Markers for what not every machine has: a skip says so loudly, REQUIRE_* makes it an error."""

from __future__ import annotations

import functools
import importlib.util
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from support.browser import NODE_PACKAGES, browser_path
from support.disks import why_no_mount
from support.folders import ROOT, TESTS
from support.hosts import bpy_python

# before NumPy is loaded, as on the command line: more threads spin while another process computes
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # for tests that load ONNX Runtime themselves
SHARED = ROOT.parent / "shared"
hypothesis.settings.register_profile("no deadline", deadline=None)  # a loaded machine is no fault
hypothesis.settings.load_profile("no deadline")


def pytest_sessionstart() -> None:
    """Prepare what the tests' own processes inherit.

    Triton, which torch's CUDA build brings, is loaded before OpenGL: after Mesa's LLVM it crashes.
    A shell lets what it starts in the background ignore interrupts; the tests send them.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if importlib.util.find_spec("triton") is not None:
        importlib.import_module("triton")


@functools.cache
def _why_no_gl() -> str:
    from nlens_video.render.opengl.egl_platform import open_platform

    try:
        open_platform().delete_context()
    except RuntimeError as error:
        return f"OpenGL cannot start ({error}); apt-get install libegl1 libgl1"
    return ""


@functools.cache
def _why_no_torch() -> str:
    found = importlib.util.find_spec("torch") is not None
    return "" if found else "torch is not installed; pip install nlens-video[train]"


@functools.cache
def _why_no_cuda() -> str:
    from nlens_video.networks.device import why_no_cuda

    return why_no_cuda()


@functools.cache
def _why_no_truth() -> str:
    found = (SHARED / "data").is_dir()
    return "" if found else f"no ground truth at {SHARED / 'data'}"


@functools.cache
def _why_no_chromium() -> str:
    return "" if browser_path() else "no chromium; apt-get install chromium"


_PACKAGES = {
    "ffmpeg": "ffmpeg",
    "ffprobe": "ffmpeg",
    "gst-launch-1.0": "gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good",
}
"""The Debian packages of each program that `needs_programs` may name; the Makefile has them too."""


def _why_no_programs(names: tuple[str, ...]) -> str:
    missing = [name for name in names if shutil.which(name) is None]
    packages = " ".join(dict.fromkeys(_PACKAGES[name] for name in missing))
    return f"no {' and no '.join(missing)}; apt-get install {packages}" if missing else ""


@functools.cache
def _why_no_blender() -> str:
    if not shutil.which("blender"):
        return "no blender; apt-get install blender python3-numpy"
    look = ["--python-exit-code", "1", "--python-expr", "import numpy"]
    run = subprocess.run(["blender", "-b", *look], check=False, capture_output=True)
    lacking = "Blender's Python has no numpy, which its glTF add-on needs"
    return f"{lacking}; apt-get install python3-numpy" if run.returncode else ""


@functools.cache
def _why_no_bpy() -> str:
    found = bpy_python().exists()
    return "" if found else "no Python with bpy; make adapters, or name it in BPY_PYTHON"


@functools.cache
def _why_no_vapoursynth() -> str:
    found = importlib.util.find_spec("vapoursynth") is not None
    return "" if found else "no vapoursynth; Python 3.12, pip install nlens-video[vapoursynth]"


@functools.cache
def _why_no_gstreamer_python() -> str:
    from nlens_video.adapters.gstreamer_install import install_problem

    return install_problem()


@functools.cache
def _why_no_node_packages() -> str:
    found = all((NODE_PACKAGES / name).is_dir() for name in ("axe-core", "typescript"))
    return "" if found else "no packages of tests/studio/package.json; npm ci --prefix tests/studio"


@functools.cache
def _why_no_gstreamer_network() -> str:
    elements = ("rtspclientsink", "x264enc", "openh264dec", "webrtcbin", "nicesink", "pipewiresink")
    lacking = []
    for one in elements:  # --exists compares versions, and nice's own is below 1.0
        run = subprocess.run(["gst-inspect-1.0", one], check=False, stdout=subprocess.DEVNULL)
        lacking += [one] if run.returncode else []
    programs = ("Xvfb", "pipewire", "wireplumber", "dbus-run-session")
    lacking += [one for one in programs if not shutil.which(one)]
    found = list(Path("/usr/lib").glob("*/girepository-1.0/GstRtspServer-1.0.typelib"))
    lacking += [] if found else ["GstRtspServer"]
    packages = (
        "gir1.2-gst-rtsp-server-1.0 gstreamer1.0-rtsp gstreamer1.0-nice gstreamer1.0-plugins-bad "
        "gstreamer1.0-plugins-ugly gir1.2-gst-plugins-bad-1.0 gstreamer1.0-x xvfb "
        "gstreamer1.0-pipewire pipewire wireplumber dbus"
    )
    return f"no {', '.join(lacking)}; apt-get install {packages}" if lacking else ""


@functools.cache
def _why_no_root() -> str:
    return "not root, who alone can run a program as another user" if os.geteuid() else ""


_NEEDS = {
    "needs_gl": ("REQUIRE_GL", _why_no_gl),
    "needs_torch": ("REQUIRE_TORCH", _why_no_torch),
    "needs_cuda": ("REQUIRE_CUDA", _why_no_cuda),
    "needs_blender": ("REQUIRE_BLENDER", _why_no_blender),
    "needs_bpy": ("REQUIRE_BPY", _why_no_bpy),
    "needs_vapoursynth": ("REQUIRE_VAPOURSYNTH", _why_no_vapoursynth),
    "needs_gstreamer_python": ("REQUIRE_GSTREAMER_PYTHON", _why_no_gstreamer_python),
    "needs_gstreamer_network": ("REQUIRE_GSTREAMER_NETWORK", _why_no_gstreamer_network),
    "needs_chromium": ("REQUIRE_CHROMIUM", _why_no_chromium),
    "needs_node_packages": ("REQUIRE_NODE_PACKAGES", _why_no_node_packages),
    "needs_mount": ("REQUIRE_MOUNT", why_no_mount),
    "needs_root": ("REQUIRE_ROOT", _why_no_root),
    "needs_truth": ("REQUIRE_TRUTH", _why_no_truth),
}


SLOW_SUITES = {"hard", "end_to_end", "training"}
"""Suites that run programs, networks' training or hundreds of damaged files."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        folders = item.path.relative_to(TESTS).parts
        if folders[0] in SLOW_SUITES:
            item.add_marker("slow")
        if "endurance" in folders:
            item.add_marker("endurance")


def pytest_runtest_setup(item: pytest.Item) -> None:
    for marker, (variable, why) in _NEEDS.items():
        if item.get_closest_marker(marker) is None:
            continue
        _unless(why(), variable)
    named = {name for mark in item.iter_markers("needs_programs") for name in mark.args}
    _unless(_why_no_programs(tuple(sorted(named))), "REQUIRE_PROGRAMS")


def _unless(reason: str, variable: str) -> None:
    """Skip for a reason, or fail where the variable says that everything must be there."""
    if reason and os.environ.get(variable) == "1":
        pytest.fail(f"{variable}=1, but {reason}", pytrace=False)
    if reason:
        pytest.skip(reason)


@pytest.fixture(autouse=True)
def ordinary_priority_is_kept() -> Iterator[None]:
    """A test that is left with a real-time thread would stop the machine with the next ones."""
    yield
    if hasattr(os, "sched_getscheduler"):
        left = os.sched_getscheduler(0)
        if left:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        assert left == os.SCHED_OTHER, "this thread has become a real-time one"


@pytest.fixture
def shared() -> Path:
    """The folder of the ground truth; use it with the marker needs_truth."""
    return SHARED
