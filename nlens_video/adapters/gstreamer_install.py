"""Shows GStreamer the element `nlens`: `python -m nlens_video.adapters.gstreamer_install`.

GStreamer's loader of Python plug-ins runs the system's Python with the packages of the environment
that comes first on the PATH. The file that is written here, into the user's folder of plug-ins,
adds this environment's. The loader itself needs PyGObject, which has no wheel: where this
environment does not see the system's, it gets a link to it.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from nlens_video.core.errors import NlensError, UsageError

PACKAGES = "gstreamer1.0-tools gstreamer1.0-python3-plugin-loader python3-gst-1.0"
"""Debian's, for GStreamer, its loader and its Python bindings."""
_BINDINGS = Path("/usr/lib/python3/dist-packages/gi")
_PLUGIN = """\
\"\"\"Written by nlens_video.adapters.gstreamer_install: this environment's element.\"\"\"

import sys

# GStreamer's loader goes on using this list without holding it, while OpenCV puts another in its
# place: here the list is held, and put back with the other's content
before = sys.path
before += [path for path in {paths!r} if path not in before]
from nlens_video.adapters.gstreamer_element import ELEMENT

before[:] = sys.path
sys.path = before
__gstelementfactory__ = ELEMENT
"""


def install() -> tuple[Path, ...]:
    """Write the plug-in's file, and link PyGObject where it is not seen.

    GStreamer keeps in its registry that the loader failed, as it does in an environment without
    PyGObject, and never tries it again: that registry is removed, and made anew.

    Returns:
        What was written.

    Raises:
        UsageError: GStreamer's loader is missing, or runs another Python, or the environment that
            is first on the PATH keeps it from the element.
    """
    why = install_problem()
    if why:
        raise UsageError(why)
    written = []
    if importlib.util.find_spec("gi") is None:
        link = Path(sysconfig.get_path("platlib"), "gi")
        link.symlink_to(_BINDINGS)
        written.append(link)
    plugin = Path.home() / ".gstreamer-1.0" / "plugins" / "python" / "nlens.py"
    plugin.parent.mkdir(parents=True, exist_ok=True)
    source = str(Path(__file__).resolve().parents[2])
    paths = [source, sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
    plugin.write_text(_PLUGIN.format(paths=list(dict.fromkeys(paths))), encoding="utf-8")
    if _load_failure():
        for registry in _registries():
            registry.unlink(missing_ok=True)
        why = _load_failure()
        if why:
            first = Path(sysconfig.get_path("scripts"))
            raise UsageError(f"GStreamer cannot load nlens: {why}; put {first} first on the PATH")
    return (*written, plugin)


def _load_failure() -> str:
    """What GStreamer says first when it looks for the element; empty if it finds it."""
    run = subprocess.run(
        [shutil.which("gst-inspect-1.0") or "", "nlens"], capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    if run.returncode == 0:
        return ""
    return (run.stderr + run.stdout).strip().partition("\n")[0]


def _registries() -> list[Path]:
    """The files in which GStreamer keeps what it found."""
    given = os.environ.get("GST_REGISTRY_1_0") or os.environ.get("GST_REGISTRY")
    if given:
        return [Path(given)]
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return list((caches / "gstreamer-1.0").glob("registry.*.bin"))


def install_problem() -> str:
    """Why this environment's element cannot be shown to GStreamer, in a line; empty if it can."""
    inspect = shutil.which("gst-inspect-1.0")
    if inspect is None:
        return f"no gst-inspect-1.0; apt-get install {PACKAGES}"
    with tempfile.TemporaryDirectory() as folder:  # the user's registry may know of a failure
        alone = {**os.environ, "PATH": os.defpath, "GST_REGISTRY": str(Path(folder, "registry"))}
        run = subprocess.run(
            [inspect, "python"], capture_output=True, text=True, check=False, env=alone
        )
    file = re.search(r"^ *Filename +(\S+)", run.stdout, re.M)
    linked = None
    if file is not None:
        linked = re.search(rb"libpython(3\.\d+)", Path(file[1]).read_bytes())
    if linked is None:
        return f"GStreamer has no loader of Python plug-ins; apt-get install {PACKAGES}"
    here, there = f"{sys.version_info.major}.{sys.version_info.minor}", linked[1].decode()
    if there != here:
        return (
            f"GStreamer's loader runs Python {there}, this environment is of {here}, whose "
            f"packages it cannot load; make one with python{there}"
        )
    if importlib.util.find_spec("gi") is None and not _BINDINGS.is_dir():
        return f"no {_BINDINGS}; apt-get install {PACKAGES}"
    return ""


def main() -> int:
    """Install, and say what was written; the exit code."""
    argparse.ArgumentParser(
        prog="python -m nlens_video.adapters.gstreamer_install", allow_abbrev=False,
        description="Show GStreamer this environment's element nlens; prints what is written.",
    ).parse_args()  # fmt: skip
    try:
        for path in install():
            sys.stdout.write(f"{path}\n")
    except NlensError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
