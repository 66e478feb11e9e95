"""A cached kernel is compiled again when what is compiled into it has changed, and only then."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import nlens_video

PACKAGE = Path(nlens_video.__file__).parent
KERNEL = """
from nlens_video.kernels.numba_config import kernel
from nlens_video.kernels import (
    tried_between as other,
)

@kernel
def scaled(value):
    return other.FACTOR * value
"""
RUN = """
from nlens_video.kernels.tried_kernel import scaled
print(scaled(2.0), sum(scaled.stats.cache_hits.values()))
"""


@pytest.fixture
def package(tmp_path):
    """A copy with a kernel into which a constant is compiled that comes by way of two modules."""
    copy = tmp_path / "nlens_video"
    for part in ("core", "kernels"):
        shutil.copytree(
            PACKAGE / part, copy / part, ignore=shutil.ignore_patterns("__pycache__", "*.nb?")
        )
    shutil.copy(PACKAGE / "__init__.py", copy)
    (copy / "kernels" / "tried_kernel.py").write_text(KERNEL)
    between = "from nlens_video.kernels.tried_constant import FACTOR\n"
    (copy / "kernels" / "tried_between.py").write_text(between)
    return copy


@pytest.mark.slow
def test_kernel_is_compiled_again_when_a_constant_of_another_module_changes(package, tmp_path):
    constant = package / "kernels" / "tried_constant.py"
    said = []
    for factor in (3.0, 3.0, 5.0, 5.0):
        if not constant.exists() or constant.read_text() != f"FACTOR = {factor}\n":
            constant.write_text(f"FACTOR = {factor}\n")
        constant.touch()  # a file that is merely written again is no change
        ran = subprocess.run(
            [sys.executable, "-B", "-c", RUN], capture_output=True, text=True, check=True,
            env={**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONSAFEPATH": "1"},
        )  # fmt: skip
        said.append(ran.stdout.split())
    assert said == [["6.0", "0"], ["6.0", "1"], ["10.0", "0"], ["10.0", "1"]]
