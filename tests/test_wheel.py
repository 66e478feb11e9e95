"""The installed wheel, not only the checkout: built, installed into a new environment, run."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from support.folders import ROOT
from support.installation import build_wheel, install


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Names of the files of the source archive, and its size [byte]."""
    folder = tmp_path_factory.mktemp("archive")
    subprocess.run(
        [sys.executable, "-m", "build", "--sdist", "--no-isolation", "-o", folder, ROOT],
        check=True, capture_output=True,
    )  # fmt: skip
    (built,) = folder.glob("*.tar.gz")
    with tarfile.open(built) as content:
        files = [one.name.partition("/")[2] for one in content if one.isfile()]
    return set(files), built.stat().st_size


@pytest.mark.slow
def test_source_archive_holds_what_its_make_targets_need(archive):
    names, size = archive
    assert {
        "Makefile", "hatch_build.py", "constraints.txt", "samples/in.mp4", "samples/anim.glb",
        "docs/camera.md", "mkdocs.yml", "CONTRIBUTING.md", "SECURITY.md", "CITATION.cff",
        ".ci/run", "nlens_video/native/CMakeLists.txt", "models/coc/coc.onnx",
    } <= names  # fmt: skip
    left_over = [one for one in names if "__pycache__" in one or "node_modules" in one]
    assert not left_over and "samples/out.mp4" not in names
    assert not any(one.endswith(".so") for one in names)
    assert size < 50 << 20


@pytest.mark.slow
def test_source_archive_holds_every_file_of_the_repository(archive):
    names, _ = archive
    if not (ROOT / ".git").exists():
        pytest.skip("run from an unpacked source archive: there is no git list to compare with")
    listed = subprocess.check_output(["git", "-C", ROOT, "ls-files", "-z"], text=True)
    kept = {one for one in listed.split("\0") if one and (ROOT / one).is_file()}
    assert kept - names == set()


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
