"""A run writes its result and the requested side files, and nothing else."""

import os
import subprocess
import sys

import numpy as np
import pytest
from support import shots

from nlens_video.video.exr import write_layers

pytestmark = pytest.mark.needs_gl


def contents(folder):
    """Each file and folder, with what would show that it was written to."""
    return {
        path.relative_to(folder): (path.stat().st_mtime_ns, path.stat().st_size)
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def place(tmp_path):
    for name in ("in", "out", "home", "tmp", "here"):
        (tmp_path / name).mkdir()
    shots.write_video(tmp_path / "in" / "in.mp4", 6)
    shots.cube_glb(tmp_path / "in" / "anim.glb", start=(-0.2, 0, -1.6), end=(0.3, 0, -1.5))
    layer = {name: np.ones((shots.HEIGHT, shots.WIDTH), np.float32) for name in "RGBAZ"}
    write_layers(tmp_path / "in" / "layer.exr", layer)
    return tmp_path


@pytest.mark.parametrize("more", [[], ["--layers", "layer.exr"], ["--resume"]])
def test_run_writes_only_into_its_results_folder(place, more):
    given = [str(place / "in" / word) if word.endswith(".exr") else word for word in more]
    environment = {**os.environ, "HOME": str(place / "home"), "TMPDIR": str(place / "tmp")}
    for name in ("XDG_CACHE_HOME", "ORT_DISABLE_TELEMETRY", "CI"):
        environment.pop(name, None)
    before = contents(place)
    done = subprocess.run(
        [sys.executable, "-m", "nlens_video", str(place / "in" / "in.mp4"),
         str(place / "in" / "anim.glb"), str(place / "out" / "out.mp4"), "-q", *given],
        cwd=place / "here", env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    after = contents(place)
    assert {str(path) for path in after.keys() - before.keys()} == {"out/out.mp4"}
    assert {path: after[path] for path in before} == before
    assert not [path for path in place.rglob("*") if path.is_dir() and path.parent != place]
