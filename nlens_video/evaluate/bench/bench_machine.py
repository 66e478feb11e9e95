"""What `bench` ran on: without this, times mean nothing."""

from __future__ import annotations

import os
import platform
from pathlib import Path

from nlens_video.core.version import VERSION
from nlens_video.render.select import renderer_choice


def machine() -> dict[str, str]:
    """Processor, cores, load, renderer and versions in words; nothing that names the machine."""
    return {
        "processor": _processor(),
        "cores": str(_cores()),
        "load at the start": _load(),
        "renderer": renderer_choice(),
        "system": f"{platform.system()} {platform.machine()}",
        "version": f"nlens-video {VERSION}, Python {platform.python_version()}",
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
