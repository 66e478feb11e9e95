"""Checksums of a file's packets, in a line appended after the container's last packet."""

from __future__ import annotations

import json
from pathlib import Path

_START = b"NLENSCRC"  # NUT takes what begins with N for a header, knows none such, and goes on
_LENGTH = 16  # bytes of the line's length at the very end, in decimals


def append_checksums(path: Path, checksums: list[int]) -> None:
    """Write the line.

    Raises:
        OSError: the disk is full.
    """
    line = json.dumps(checksums).encode()
    with path.open("ab") as file:
        file.write(_START + line + str(len(line)).rjust(_LENGTH).encode())


def read_checksums(path: Path) -> list[int]:
    """Read the line.

    Raises:
        ValueError: there is none: the file is not whole.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _LENGTH))
        length = int(file.read(_LENGTH))
        start = size - _LENGTH - length - len(_START)
        if length < 0 or start < 0:
            raise ValueError("no checksums")
        file.seek(start)
        text = file.read(len(_START) + length)
    found = json.loads(text.removeprefix(_START)) if text.startswith(_START) else None
    if not isinstance(found, list) or not all(type(one) is int for one in found):
        raise ValueError("no checksums")
    return found
