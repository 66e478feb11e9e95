"""The installed wheel, not only the checkout: built, installed into a new environment, run."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.installation import build_wheel, install


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return build_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.mark.slow  # the kernels are compiled
def test_wheel_carries_kernels_pipelines_models_shaders_and_types(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.startswith("nlens_video/native/_baseline.") for name in names)
    assert not any(name.startswith("nlens_video/native/source/") for name in names)
    assert "nlens_video/data/pipelines/standard.toml" in names
    assert "nlens_video/data/models/manifest.toml" in names
    assert "nlens_video/data/models/coc/coc.onnx" in names
    assert "nlens_video/py.typed" in names
    assert any(name.startswith("nlens_video/render/opengl/shaders/") for name in names)
    assert not any(
        name.startswith(("tests/", "samples/", "pipelines/", "models/")) for name in names
    )


@pytest.mark.slow
def test_installed_wheel_runs_outside_the_repository(wheel, tmp_path):
    home = tmp_path / "venv"
    python = install(wheel, home, Path(sys.executable))
    (own,) = home.glob("lib/python*/site-packages")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    where = subprocess.run(
        [python, "-c", "import nlens_video; print(nlens_video.__file__)"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert where.stdout.startswith(str(own))
    found = subprocess.run(
        [home / "bin" / "nlens-video", "doctor"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stdout + found.stderr
    assert "sha256" in found.stdout and "standard" in found.stdout
