"""Memory is bounded by the frame's size, never by the clip's length."""

import subprocess
import sys

import pytest
from support import shots

pytestmark = pytest.mark.needs_gl

MEASURE = """
import resource, sys
from nlens_video.cli.main import main
code = main(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
sys.exit(code)
"""


def peak_mb(folder, frames):
    words = [
        "testsrc2=size=320x180:rate=25", folder / "anim.glb", folder / f"{frames}.mkv",
        "--input-format", "lavfi", "--range", f"0:{frames}", "--fit", folder / "fit.json",
        "--timings", folder / f"{frames}.json", "--report", folder / f"report{frames}", "-q",
    ]  # fmt: skip
    command = [sys.executable, "-c", MEASURE, *map(str, words)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    return int(run.stdout.split()[-1]) / 1024


@pytest.mark.slow
def test_peak_memory_is_the_same_for_a_clip_six_times_as_long(tmp_path):
    shots.cube_glb(tmp_path / "anim.glb", end=(0.3, 0.0, -2.6), seconds=12.0)
    shots.fit_json(tmp_path / "fit.json")
    short, long = peak_mb(tmp_path, 60), peak_mb(tmp_path, 360)
    # 300 more frames of 320x180 would be 24 MB as yuv420p alone, more as floats
    assert long - short < 12
