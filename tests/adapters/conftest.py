"""Plates for the adapters, and what the command line makes of them: once a process."""

import functools
import subprocess
from pathlib import Path

import pytest
from support.conformance import by_command_line, write_plate
from support.gstreamer_environment import install_element, user_environment


@pytest.fixture(scope="session")
def plates(tmp_path_factory):
    """The plate of a case, by its name."""
    return functools.cache(lambda case: write_plate(tmp_path_factory.mktemp("plate"), case))


@pytest.fixture(scope="session")
def expected(plates):
    """What the command line makes of it."""
    return functools.cache(lambda case: by_command_line(plates(case)))


@pytest.fixture(scope="session")
def environment(tmp_path_factory):
    """A user's environment and home, in which the element is installed as the page says."""
    environment, venv = user_environment(tmp_path_factory.mktemp("gstreamer"))
    run = install_element(environment)
    assert run.returncode == 0, run.stderr
    link, plugin = map(Path, run.stdout.split())
    assert link.is_relative_to(venv) and link.name == "gi"
    assert plugin.is_relative_to(environment["HOME"])
    return environment


@pytest.fixture
def launch(environment):
    """Runs a line of gst-launch-1.0 in a folder."""

    def run(line, folder):
        words = ["bash", "-c", line]
        try:
            return subprocess.run(
                words, env=environment, cwd=folder, capture_output=True, text=True, check=False,
                timeout=60,
            )  # fmt: skip
        except subprocess.TimeoutExpired as stayed:
            # gst-launch-1.0 of 1.22 may stay after an error of any element on a loaded machine
            told = [(said or b"").decode() for said in (stayed.stdout, stayed.stderr)]
            if "ERROR: from element" not in told[1]:
                raise
            return subprocess.CompletedProcess(words, 1, *told)

    return run
