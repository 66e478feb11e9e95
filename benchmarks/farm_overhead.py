"""What a farm of one worker on this machine costs beside a single run.

    python benchmarks/farm_overhead.py [--pairs N] [--chunk SECONDS] [--turns N] [--preset NAME]

The demo's plate, ten times over (60 s of 960x512), with its object, by both in turn. Processor time
is the whole machine's, since Ray's processes are nobody's children at the end: nothing else may run
beside, and it needs Linux. Results are compared byte for byte. Kernels must have been compiled
before.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from farm_kill import SAMPLES, TURNS, long_plate


def machine_s() -> float:
    """Processor time of all processes since the machine started [s]."""
    user, nice, system = map(int, Path("/proc/stat").read_text().split()[1:4])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def timed(words: list[str]) -> tuple[float, float]:
    """Run the program; elapsed and processor time [s]."""
    start, cpu = time.perf_counter(), machine_s()
    subprocess.run([sys.executable, "-m", "nlens_video", *words], check=True)
    return time.perf_counter() - start, machine_s() - cpu


def main() -> None:
    """Print each pair and the medians; the exit code tells whether the results are equal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--chunk", type=float, default=10.0)
    parser.add_argument("--turns", type=int, default=TURNS)
    parser.add_argument("--preset", default="standard")
    asked = parser.parse_args()
    ratios = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plate, direct, farm = folder / "in.mp4", folder / "direct.mp4", folder / "farm.mp4"
        frames = long_plate(plate, asked.turns)
        ran = ["--loop", "--preset", asked.preset, "-q", "--no-progress"]
        given = [str(plate), str(SAMPLES / "anim.glb")]
        more = ["--workers", "1", "--chunk", str(asked.chunk)]
        print(f"{frames} frames, {asked.preset}, chunks of {asked.chunk:g} s, one worker")
        for _ in range(asked.pairs):
            alone_s, alone_cpu_s = timed([*given, str(direct), *ran])
            farm_s, farm_cpu_s = timed(["farm", *given, str(farm), *ran, *more])
            if direct.read_bytes() != farm.read_bytes():
                raise SystemExit("the results differ")
            ratios.append((farm_s / alone_s, farm_cpu_s / alone_cpu_s))
            print(
                f"direct {alone_s:.1f} s, farm {farm_s:.1f} s: {ratios[-1][0]:.3f}; processor "
                f"{alone_cpu_s:.1f} s, {farm_cpu_s:.1f} s: {ratios[-1][1]:.3f}",
                flush=True,
            )
    elapsed, processor = (statistics.median(one) for one in zip(*ratios, strict=True))
    print(f"medians: elapsed {elapsed:.3f}, processor {processor:.3f}")


if __name__ == "__main__":
    main()
