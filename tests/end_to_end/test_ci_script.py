"""`.ci/run` installs the adapters' host programs, and a missing one is an error in it."""

import os
import re
import subprocess

import pytest
from support.folders import ROOT

NOT_IN_CI = {"REQUIRE_CUDA", "REQUIRE_MOUNT", "REQUIRE_TRUTH"}
"""What a developer's machine alone has: the right to mount, and the ground truth."""
MAKE = """\
#!/bin/sh
echo "$1 $(env | grep -o '^REQUIRE_[A-Z_]*=1' | sort | tr '\\n' ' ')" >> "$SAID"
[ "$1" != "$FAILS" ]
"""


@pytest.fixture
def ci(tmp_path):
    """Runs the script with a `make` that says how it is called; its exit code, and the calls."""
    (tmp_path / "make").write_text(MAKE)
    (tmp_path / "make").chmod(0o755)
    said = tmp_path / "said"

    def run(fails="", **changes):
        said.write_text("")
        inherited = {
            name: value for name, value in os.environ.items() if not name.startswith("REQUIRE_")
        }
        path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
        ran = subprocess.run(
            [ROOT / ".ci" / "run"], capture_output=True, text=True, check=False,
            env={**inherited, "PATH": path, "SAID": str(said), "FAILS": fails, **changes},
        )  # fmt: skip
        calls = {}
        for line in said.read_text().splitlines():
            target, *required = line.split()
            calls[target] = {one.removesuffix("=1") for one in required}
        return ran, calls

    return run


def test_host_programs_are_installed_before_the_tests_that_then_require_them(ci):
    ran, calls = ci(PYTHON="/usr/bin/python3")
    assert ran.returncode == 0, ran.stderr
    assert list(calls) == ["hosts", "test", "vapoursynth"]
    rules = re.findall(
        r"^(?:test|vapoursynth):.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.M
    )
    required = set(re.findall(r"(REQUIRE_[A-Z_]+)=1", "".join(rules)))
    if os.geteuid():
        required.add("REQUIRE_ROOT")
    known = re.findall(r'"(REQUIRE_[A-Z_]+)"', (ROOT / "tests" / "conftest.py").read_text())
    assert calls["test"] | required == set(known) - NOT_IN_CI


def test_host_that_cannot_be_installed_fails_the_whole_after_the_other_tests(ci):
    ran, calls = ci(fails="hosts")
    assert ran.returncode != 0 and "could not be installed" in ran.stderr
    assert list(calls) == ["hosts", "test"] and "REQUIRE_BLENDER" not in calls["test"]


@pytest.mark.parametrize("target", ["test", "vapoursynth"])
def test_failed_tests_fail_the_script(ci, target):
    assert ci(fails=target)[0].returncode != 0


def test_python_that_gstreamer_does_not_run_is_said(ci, tmp_path):
    other = tmp_path / "other"
    other.write_text("#!/bin/sh\necho 0\n")
    other.chmod(0o755)
    ran, calls = ci(PYTHON=str(other))
    assert ran.returncode == 0 and "Not tested here: GStreamer's element" in ran.stderr
    assert "REQUIRE_GSTREAMER_PYTHON" not in calls["test"]
