"""The scene reader under atheris, which looks for inputs that reach new code.

    pip install atheris
    PYTHONPATH=tests python -m hard.fuzz.guided FOLDER -max_total_time=150 -timeout=20 -max_len=8192

FOLDER takes the sound files to start from and what is found; the options are libFuzzer's.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["nlens_video.scene"]):
    from nlens_video.scene import Scene

from hard.fuzz import seeds

from nlens_video.core.errors import NlensError

_PATH = Path(tempfile.mkdtemp(prefix="nlens-fuzz-")) / "scene.glb"


def read(data: bytes) -> None:
    """Read the bytes as a GLB and look at all of it."""
    _PATH.write_bytes(data)
    try:
        scene = Scene.load(_PATH)
        scene.pose(0.5).vertices()
        scene.triangles(1.0)
        if scene.camera_names:
            scene.camera(0.5, 64, 48)
    except NlensError as error:
        assert "\n" not in str(error)


if __name__ == "__main__":
    seeds.scenes(Path(sys.argv[1]))
    warnings.simplefilter("error")
    atheris.Setup(sys.argv, read)
    atheris.Fuzz()
