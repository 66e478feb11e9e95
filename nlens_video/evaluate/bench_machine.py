"""What `bench` ran on: without this, times mean nothing."""

from __future__ import annotations

import os
import platform
from pathlib import Path

from nlens_video import __version__
from nlens_video.errors import NlensError


def machine() -> dict[str, str]:
    """Processor, cores, load, OpenGL and versions in words; nothing that names the machine.

    Raises:
        NlensError: OpenGL cannot start.
    """
    return {
        "processor": _processor(),
        "cores": str(_cores()),
        "load at the start": _load(),
        "OpenGL": _opengl(),
        "system": f"{platform.system()} {platform.machine()}",
        "version": f"nlens-video {__version__}, Python {platform.python_version()}",
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:  # not Linux
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _load() -> str:
    """Processes that wanted to run in the last minute, on average."""
    if not hasattr(os, "getloadavg"):
        return "unknown"
    return f"{os.getloadavg()[0]:.1f}"


def _opengl() -> str:
    try:
        from nlens_video.backends.gl_platform import describe, open_platform

        context = open_platform()
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        raise NlensError(
            f"bench draws its scenes with OpenGL, which cannot start ({error}); "
            "install it: apt-get install libegl1 libgl1"
        ) from error
    try:
        return describe()
    finally:
        context.delete_context()
