"""Where the tests find host programs that are environments of their own."""

from __future__ import annotations

import os
from pathlib import Path

from support.folders import ROOT


def bpy_python() -> Path:
    """The Python that has the wheel `bpy`: `make adapters` makes its environment."""
    return Path(os.environ.get("BPY_PYTHON", ROOT / ".venv-bpy" / "bin" / "python"))
