"""The wheel, built and installed into an environment of its own; a user who may only read it."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from support.folders import ROOT

SITE = next(Path(path) for path in sys.path if path.endswith("site-packages"))
NOBODY = 65534


def build_wheel(folder: Path) -> Path:
    """Build the checkout's wheel into a folder; returns its file."""
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", folder, ROOT],
        check=True,
        capture_output=True,
    )
    (built,) = folder.glob("*.whl")
    return built


def install(wheel: Path, home: Path, python: Path) -> Path:
    """Install a wheel into a new environment at `home`; returns the environment's Python.

    Its dependencies are those already installed here; the wheel itself comes from the file alone.
    """
    subprocess.run([python, "-m", "venv", "--symlinks", home], check=True)
    inside = home / "bin" / "python"
    subprocess.run(
        [inside, "-m", "pip", "install", "-q", "--no-deps", "--no-index", wheel], check=True
    )
    (own,) = home.glob("lib/python*/site-packages")
    (own / "dependencies.pth").write_text(f"{SITE}\n")
    return inside


def python_for_others() -> Path | None:
    """A Python of this version that any user can run and that finds the packages; or None."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    for path in (Path(os.path.realpath(sys.executable)), Path("/usr/bin") / version):
        code = f"import sys, ensurepip; sys.path.append({str(SITE)!r}); import numpy"
        try:
            found = subprocess.run(
                [path, "-c", code], cwd="/", capture_output=True, check=False, **other_user()
            )
        except OSError:
            continue
        if found.returncode == 0:
            return path
    return None


def other_user(uid: int = NOBODY) -> dict[str, Any]:
    """Arguments of `subprocess` for another user without rights, where root; else none."""
    return {} if os.geteuid() else {"user": uid, "group": uid, "extra_groups": []}


@contextmanager
def open_folder() -> Iterator[Path]:
    """A folder that every user may enter and write to, as /tmp; pytest's are the caller's alone."""
    with tempfile.TemporaryDirectory(prefix="nlens-test-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        folder.chmod(0o1777)
        yield folder


def read_only(folder: Path) -> None:
    """Take the right to write from everyone; root may write none the less."""
    for path in (folder, *folder.rglob("*")):
        if not path.is_symlink():
            path.chmod(path.stat().st_mode & ~0o222 | 0o444)


def writable(folder: Path) -> None:
    """Give folders back the right that `read_only` took, so that they can be removed."""
    for path in (folder, *folder.rglob("*")):
        if path.is_dir() and not path.is_symlink():
            path.chmod(path.stat().st_mode | 0o700)


def run_as_other(
    *words: object, cwd: Path, environment: Mapping[str, str], uid: int = NOBODY
) -> subprocess.CompletedProcess[str]:
    """Run a program as another user, with these variables and a PATH only."""
    return subprocess.run(
        [str(word) for word in words], cwd=cwd, env={"PATH": "/usr/bin:/bin", **environment},
        capture_output=True, text=True, check=False, **other_user(uid),
    )  # fmt: skip
