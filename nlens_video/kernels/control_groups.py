"""Limits of the container: what Linux's control groups of version 2 and 1 allow it."""

from __future__ import annotations

import functools
import math
from pathlib import Path

MOUNTED = Path("/sys/fs/cgroup")
"""Folder of the container's own group."""


def memory_limit(group: Path = MOUNTED) -> int | None:
    """Memory that the container may use [bytes]; None without a limit.

    Args:
        group: folder of the group.
    """
    words = _words(group / "memory.max") or _words(group / "memory/memory.limit_in_bytes")
    return int(words[0]) if words and words[0].isdigit() else None


@functools.cache
def processor_quota(group: Path = MOUNTED) -> int | None:
    """Processors whose time the container may use, a part of one counted as one; None: no limit.

    It is read once for each folder.

    Args:
        group: folder of the group.
    """
    words = _words(group / "cpu.max") or [
        *_words(group / "cpu/cpu.cfs_quota_us"), *_words(group / "cpu/cpu.cfs_period_us")
    ]  # fmt: skip
    if len(words) != 2 or not all(word.isdigit() and int(word) for word in words):
        return None  # "max", or -1 in version 1
    quota_us, period_us = map(int, words)
    return math.ceil(quota_us / period_us)


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    except OSError:
        return []
