"""Whole runs of the sample at larger frames: a frame's time, the first frame's, peak memory.

    python benchmarks/bench_sizes.py [--presets NAME,NAME] [--heights N,N] [--frames N]

The object covers as large a share of each frame. A run is a process of its own. What a frame takes
is what a run of all frames takes longer than one of a third of them, a frame.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench_demo import PRESETS, SAMPLES, Cost, plainly, waited_for
from bench_device import enlarged


def composited(plate: Path, preset: str, frames: int) -> Cost:
    """A run of the command line over the first frames."""
    words = [str(plate), str(SAMPLES / "anim.glb"), str(plate.with_name("out.mp4"))]
    options = ["--preset", preset, "--range", f"0:{frames}", "--no-progress", "-q", "-y"]
    return waited_for(subprocess.Popen([sys.executable, "-m", "nlens_video", *words, *options]))


def main() -> None:
    """Print a row a size and preset."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presets", default=PRESETS)
    parser.add_argument("--heights", default="512,1080,2160")
    parser.add_argument("--frames", type=int, default=48)
    words = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}; ms a frame: elapsed, processor time; s to frame 0; MB")
    for height in map(int, words.heights.split(",")):
        with tempfile.TemporaryDirectory() as name:
            plate = enlarged(height, words.frames, Path(name) / "plate.mp4")
            floor = plainly(plate, Path(name))
            row = [1000.0 * cost / words.frames for cost in (floor.elapsed_s, floor.processor_s)]
            print(f"{height:5d} decode + encode {row[0]:8.1f} {row[1]:8.1f}", flush=True)
            for preset in words.presets.split(","):
                some = words.frames // 3
                first, few, all_of_them = (
                    composited(plate, preset, count) for count in (1, some, words.frames)
                )
                count = words.frames - some
                elapsed = 1000.0 * (all_of_them.elapsed_s - few.elapsed_s) / count
                spent = 1000.0 * (all_of_them.processor_s - few.processor_s) / count
                print(
                    f"{height:5d} {preset:15s} {elapsed:8.1f} {spent:8.1f}"
                    f" {first.elapsed_s:8.1f} {all_of_them.memory_mb:8.0f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
