"""`make test` lists the system programs that it needs and cannot install."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.folders import ROOT

PACKAGES = (
    "ffmpeg gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good "
    "gstreamer1.0-python3-plugin-loader python3-gst-1.0 gir1.2-gst-plugins-base-1.0 "
    "chromium npm"  # Debian's
)
SHELL = ("make", "sh", "id", "true")


def bare_path(folder, *names):
    """A PATH with these programs alone."""
    folder.mkdir()
    folder.chmod(0o755)
    for name in names:
        (folder / name).symlink_to(shutil.which(name))
    return str(folder)


def make_programs(path, **options):
    return subprocess.run(
        ["make", "-C", ROOT, "--no-print-directory", "programs"],
        env={"PATH": path}, capture_output=True, text=True, check=False, **options,
    )  # fmt: skip


def test_missing_programs_are_listed_if_they_cannot_be_installed(tmp_path):
    run = make_programs(bare_path(tmp_path / "bin", *SHELL))
    assert run.returncode != 0
    assert f"Install what your system calls: {PACKAGES}\n" in run.stderr


@pytest.mark.skipif(shutil.which("apt-get") is None, reason="apt-get: this is no Debian")
def test_missing_programs_are_listed_for_a_user_without_install_rights(tmp_path):
    path = bare_path(tmp_path / "bin", *SHELL, "apt-get")
    if os.geteuid() == 0:  # /root is closed to others, so root stands in with an id of its own
        (tmp_path / "bin" / "id").unlink()
        (tmp_path / "bin" / "id").write_text("#!/bin/sh\necho 1000\n")
        (tmp_path / "bin" / "id").chmod(0o755)
    run = make_programs(path)
    assert run.returncode != 0
    assert f"no right to install it. Ask for: apt-get install {PACKAGES}\n" in run.stderr


@pytest.mark.needs_programs("ffmpeg", "ffprobe", "gst-launch-1.0")
@pytest.mark.needs_node_packages
def test_nothing_is_installed_if_all_programs_exist():
    run = make_programs(os.environ["PATH"])
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


@pytest.mark.needs_gl
def test_libraries_are_found_without_sbin_on_the_path():
    path = f"{Path(sys.executable).parent}:/usr/bin:/bin"
    run = subprocess.run(
        ["make", "-C", ROOT, "--no-print-directory", "system", f"PYTHON={sys.executable}"],
        env={"PATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


@pytest.mark.needs_gl
@pytest.mark.parametrize("host", ["VAPOURSYNTH", "BPY"])
def test_missing_python_of_a_host_is_said_with_the_variable_that_names_one(host):
    run = subprocess.run(
        ["make", "-B", "-C", ROOT, f".venv-{host.lower()}/.installed", f"PYTHON_{host}=",
         f"PYTHON={sys.executable}"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode != 0 and "found. Name one: make " in run.stderr
    assert f"PYTHON_{host}=…" in run.stderr
