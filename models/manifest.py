"""The manifest of the shipped networks, one entry a network, each written by its own export."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

HEAD = (
    "# The shipped networks. The program refuses a file whose hash differs.\n"
    "# Written by the export.py of each.\n"
)


def sha256_of(weights: Path) -> str:
    """Hash of a weights file, lower-case hexadecimal."""
    return hashlib.sha256(weights.read_bytes()).hexdigest()


def write_entry(manifest: Path, name: str, entry: str) -> None:
    """Put a network's tables into the manifest; those of the others stay as they are.

    Args:
        manifest: the file, written anew.
        name: the network's.
        entry: TOML that begins with `[model.NAME]`.
    """
    text = manifest.read_text() if manifest.exists() else ""
    tables = [part for part in re.split(r"(?m)^(?=\[model\.)", text)[1:]]
    own = re.compile(rf"\[model\.{re.escape(name)}[.\]]")
    kept = [part.strip() for part in tables if not own.match(part)]
    manifest.write_text("\n\n".join([HEAD.strip(), *kept, entry.strip()]) + "\n")
