"""Disks of a few kilobytes, where this machine lets us mount one."""

from __future__ import annotations

import contextlib
import functools
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def small_disk(folder: Path, kilobytes: int, *, options: str = "") -> Iterator[Path]:
    """Mount a disk of a size in memory.

    Args:
        folder: where; made.
        kilobytes: what fits on it [KiB].
        options: of mount, such as `ro`.
    """
    folder.mkdir(exist_ok=True)
    given = ",".join(filter(None, [f"size={kilobytes}k", options]))
    command = ["mount", "-t", "tmpfs", "-o", given, "tmpfs", str(folder)]
    subprocess.run(command, check=True, capture_output=True, timeout=20)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True, timeout=20)


def fill(folder: Path) -> Path:
    """Leave no room on the disk of a folder; returns the file that takes it all."""
    filler = folder / "filler"
    with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
        while file.write(bytes(4096)):
            pass
    return filler


@functools.cache
def why_no_mount() -> str:
    """Why no disk can be mounted here; empty where one can."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            with small_disk(Path(folder) / "disk", 64):
                return ""
        except (OSError, subprocess.CalledProcessError):
            return "no disk can be mounted here; run as root"
