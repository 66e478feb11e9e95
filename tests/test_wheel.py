"""The installed wheel, not only the checkout: built, installed into a new environment, run."""

import os
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "-o", folder, ROOT],
        check=True,
        capture_output=True,
    )
    (built,) = folder.glob("*.whl")
    return built


def test_wheel_carries_pipelines_models_shaders_and_types(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert "nlens_video/data/pipelines/standard.toml" in names
    assert "nlens_video/data/models/manifest.toml" in names
    assert "nlens_video/data/models/coc/coc.onnx" in names
    assert "nlens_video/py.typed" in names
    assert any(name.startswith("nlens_video/backends/shaders/") for name in names)
    assert not any(
        name.startswith(("tests/", "samples/", "pipelines/", "models/")) for name in names
    )


def test_wheel_runs_from_elsewhere_in_an_environment_of_its_own(wheel, tmp_path):
    home = tmp_path / "venv"
    venv.EnvBuilder(with_pip=True, symlinks=True).create(home)
    python = home / "bin" / "python"
    # its dependencies are those already installed here; the wheel itself comes from the file alone
    subprocess.run(
        [python, "-m", "pip", "install", "-q", "--no-deps", "--no-index", wheel], check=True
    )
    site = next(Path(path) for path in sys.path if path.endswith("site-packages"))
    (own,) = home.glob("lib/python*/site-packages")
    (own / "dependencies.pth").write_text(f"{site}\n")
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
