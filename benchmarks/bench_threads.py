"""The demo on one processor and more: elapsed and processor time of whole runs, as ratios to two.

    python benchmarks/bench_threads.py [--presets NAME,NAME] [--rounds N]

Processors are taken away by affinity. More of them than the machine has are only told to the run:
what more threads cost is then measured, not what they gain.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from bench_demo import SAMPLES, Cost, waited_for

COUNTS = (1, 2, 4, 8)
_RUN = """
import os, sys
count = int(sys.argv[1])
os.sched_setaffinity(0, list(os.sched_getaffinity(0))[:count])
os.sched_getaffinity = lambda process: set(range(count))
os.process_cpu_count = lambda: count
from nlens_video.cli.main import main
sys.exit(main(sys.argv[2:]))
"""


def composited(preset: str, count: int, folder: Path) -> Cost:
    """A run of the command line on so many processors."""
    words = [str(SAMPLES / "in.mp4"), str(SAMPLES / "anim.glb"), str(folder / "out.mp4")]
    options = ["--preset", preset, "--no-progress", "-q", "-y"]
    return waited_for(subprocess.Popen([sys.executable, "-c", _RUN, str(count), *words, *options]))


def main() -> None:
    """Print a row a preset and count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presets", default="realtime,standard")
    parser.add_argument("--rounds", type=int, default=3)
    words = parser.parse_args()
    print(f"{len(os.sched_getaffinity(0))} processors, load {os.getloadavg()[0]:.1f}")
    print("preset      processors   elapsed  processor time  (ratio to two, medians)  memory")
    with tempfile.TemporaryDirectory() as name:
        for preset in words.presets.split(","):
            runs: dict[int, list[Cost]] = {count: [] for count in COUNTS}
            for _ in range(words.rounds):
                for count in COUNTS:
                    runs[count].append(composited(preset, count, Path(name)))
            for count in COUNTS:
                pairs = list(zip(runs[count], runs[2], strict=True))
                elapsed = statistics.median(one.elapsed_s / two.elapsed_s for one, two in pairs)
                spent = statistics.median(one.processor_s / two.processor_s for one, two in pairs)
                memory = max(one.memory_mb for one in runs[count])
                print(f"{preset:12s}{count:10d}{elapsed:10.2f}{spent:16.2f}{memory:32.0f} MB")


if __name__ == "__main__":
    main()
