"""The demo four times over, timed: whole runs of the command line as ratios to decode + encode.

    python benchmarks/bench_demo.py [--presets NAME,NAME] [--rounds N] [--times N]

Each round times plain decode + encode by PyAV, then each preset in turn, so that a machine whose
speed drifts does not fool the ratios. A run is a process of its own: its start counts. Elapsed time
means something on an idle machine only, processor time on any.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import av

from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

SAMPLES = Path(__file__).parents[1] / "samples"
PRESETS = "draft,realtime,standard"


@dataclass(frozen=True)
class Cost:
    """What a run took: elapsed and processor time [s], most memory [MB]."""

    elapsed_s: float
    processor_s: float
    memory_mb: float = 0.0


def transcode(
    plate: Path,
    output: Path,
    on_progress: Callable[[int, int | None], None] = lambda done, total: None,
) -> float:
    """Decode and encode all frames, and nothing between; seconds."""
    start = time.perf_counter()
    with open_source(str(plate)) as source, open_sink(str(output), source.info) as sink:
        source.packet_sink = sink.write_packet
        for done, frame in enumerate(source, start=1):
            sink.write(frame)
            on_progress(done, None)
        sink.commit()
    return time.perf_counter() - start


def repeated(plate: Path, times: int, output: Path) -> Path:
    """The same video packets several times over in a file of its own."""
    with av.open(str(plate)) as first, av.open(str(output), "w") as made:
        stream = made.add_stream_from_template(first.streams.video[0])
        for before in range(times):
            with av.open(str(plate)) as given:
                for packet in given.demux(video=0):
                    if packet.dts is None or packet.pts is None:
                        continue
                    offset = before * (packet.stream.duration or 0)
                    packet.dts += offset
                    packet.pts += offset
                    packet.stream = stream
                    made.mux(packet)
    return output


def waited_for(run: subprocess.Popen[bytes]) -> Cost:
    """Wait for a process that has just been started; what it took."""
    start = time.perf_counter()
    _, status, used = os.wait4(run.pid, 0)
    elapsed = time.perf_counter() - start
    run.returncode = os.waitstatus_to_exitcode(status)
    if run.returncode:
        sys.exit(f"{run.args}: ended with {run.returncode}")
    return Cost(elapsed, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)


def composited(plate: Path, folder: Path, preset: str) -> tuple[Cost, dict[str, float]]:
    """A run of the command line, and the median time of each of its nodes [ms]."""
    timings = folder / "timings.json"
    words = [str(plate), str(SAMPLES / "anim.glb"), str(folder / "out.mp4")]
    command = [
        sys.executable, "-m", "nlens_video", *words, "--preset", preset,
        "--timings", str(timings), "--no-progress", "-q",
    ]  # fmt: skip
    cost = waited_for(subprocess.Popen(command))
    return cost, json.loads(timings.read_text())["summary"]["node_median_ms"]


def plainly(plate: Path, folder: Path) -> Cost:
    """What plain decode + encode takes."""
    before = time.process_time()
    elapsed = transcode(plate, folder / "plain.mp4")
    return Cost(elapsed, time.process_time() - before)


def ratios(runs: list[Cost], plain: list[Cost], of: str) -> str:
    """Median, least and largest ratio of a run to the plain one of its round."""
    found = [getattr(run, of) / getattr(floor, of) for run, floor in zip(runs, plain, strict=True)]
    return f"{statistics.median(found):.2f} ({min(found):.2f} to {max(found):.2f})"


def main() -> None:
    """Print the ratios of each preset, and its nodes' times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--presets", default=PRESETS)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--times", type=int, default=4)
    words = parser.parse_args()
    presets = words.presets.split(",")
    plain: list[Cost] = []
    runs: dict[str, list[Cost]] = {preset: [] for preset in presets}
    nodes: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plate = repeated(SAMPLES / "in.mp4", words.times, folder / "plate.mp4")
        for _ in range(words.rounds):
            plain.append(plainly(plate, folder))
            for preset in presets:
                cost, nodes[preset] = composited(plate, folder, preset)
                runs[preset].append(cost)
    print(f"load {os.getloadavg()[0]:.1f}; plain decode + encode, medians: ", end="")
    for of in ("elapsed_s", "processor_s"):
        print(f"{statistics.median(getattr(one, of) for one in plain):.2f} s ({of[:-2]})", end=" ")
    print("\nwhole run / plain decode + encode, median (least to largest) of the rounds:")
    for preset, costs in runs.items():
        memory = max(cost.memory_mb for cost in costs)
        print(
            f"  {preset:10s} elapsed {ratios(costs, plain, 'elapsed_s'):22s}"
            f" processor {ratios(costs, plain, 'processor_s'):22s} {memory:.0f} MB"
        )
    print("nodes, median ms of the last round:")
    for node in dict.fromkeys(node for times in nodes.values() for node in times):
        row = "".join(f" {nodes[preset].get(node, float('nan')):9.2f}" for preset in presets)
        print(f"  {node:20s}{row}")


if __name__ == "__main__":
    main()
