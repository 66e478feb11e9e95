"""A user's environment for GStreamer, in which the element can be installed."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

from support.folders import ROOT


def user_environment(folder):
    """Environment variables of a user with a home and a virtual environment, and the latter.

    It has the packages of this one but PyGObject, which the installation links there.
    """
    home, venv = folder / "home", folder / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    packages = venv / "lib" / f"python3.{sys.version_info.minor}" / "site-packages"
    for package in Path(sysconfig.get_path("purelib")).iterdir():
        if package.name not in {"gi", "__pycache__"} and package.suffix != ".pth":
            (packages / package.name).symlink_to(package)
    (packages / "ours.pth").write_text(f"{ROOT}\n")
    home.mkdir()
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment = {
        **inherited, "HOME": str(home), "GST_REGISTRY": str(folder / "registry"),
        "PATH": f"{venv / 'bin'}:{os.defpath}", "VIRTUAL_ENV": str(venv),
    }  # fmt: skip
    return environment, venv


def install_element(environment):
    """Install it as the page says."""
    return subprocess.run(
        ["python", "-m", "nlens_video.adapters.gstreamer_install"], env=environment,
        cwd=environment["HOME"], capture_output=True, text=True, check=False,
    )  # fmt: skip
