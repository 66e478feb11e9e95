"""The least memory of a run, checked before libraries load that abort without it."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from pathlib import Path

from nlens_video.core.errors import NlensError

_GB = 1 << 30
ADDRESSES = 2.0 * _GB
"""Address space that libraries and their threads reserve [bytes], beside that of each core:"""
ADDRESSES_PER_CORE = 0.2 * _GB
RESIDENT = 0.4 * _GB
"""Memory that the smallest run uses [bytes]."""


def require_memory() -> None:
    """Check that a run can start.

    Raises:
        NlensError: a limit, or what is free, is below what every run needs.
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = address_space()
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise NlensError(
            f"the address space is limited to {limit / _GB:.1f} GB, at least {needed / _GB:.1f} GB "
            "are needed; call ulimit -v unlimited before"
        )
    for what, size in _memories():
        if size < RESIDENT:
            raise NlensError(
                f"{what} {size / _GB:.2f} GB of memory, at least {RESIDENT / _GB:.1f} GB are "
                "needed; end other programs, or give the container more"
            )


def address_space() -> int:
    """Address space that a run needs on this machine [bytes]."""
    return int(ADDRESSES + ADDRESSES_PER_CORE * (os.cpu_count() or 1))


def _memories() -> Iterator[tuple[str, float]]:
    """Limits of memory with their source [bytes]: the container, the machine."""
    for name in ("memory.max", "memory/memory.limit_in_bytes"):  # of control groups 2 and 1
        limit = _read(Path("/sys/fs/cgroup") / name).strip()
        if limit.isdigit():
            yield "this container allows", float(limit)
    free = dict(line.split(":", 1) for line in _read(Path("/proc/meminfo")).splitlines())
    if "MemAvailable" in free:
        kilobytes = [free.get(name, "0").split()[0] for name in ("MemAvailable", "SwapFree")]
        yield "this machine has", 1024.0 * sum(map(int, kilobytes))


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""
