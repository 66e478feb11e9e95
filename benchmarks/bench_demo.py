"""The demo, timed: each node, and the whole run as a ratio to plain decode + encode.

    python benchmarks/bench_demo.py [--preset NAME] [--rounds N]

Both are timed in turn in one run, so that a machine whose speed drifts does not fool the ratio.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    Settings,
    SourceSettings,
)
from nlens_video.graph.base.profiler import Summary
from nlens_video.run.render import OnProgress, render
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

SAMPLES = Path(__file__).parents[1] / "samples"


def transcode(
    plate: Path, output: Path, on_progress: OnProgress = lambda done, total: None
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


def composite(plate: Path, glb: Path, output: Path, preset: str) -> tuple[float, Summary]:
    """The whole job; seconds, and the nodes' times."""
    start = time.perf_counter()
    outcome = render(
        Settings(
            source=SourceSettings(spec=str(plate)),
            scene=ObjectSettings(glb=glb),
            output=OutputSettings(spec=str(output)),
            preset=preset,
        )
    )
    return time.perf_counter() - start, outcome.timing


def main() -> None:
    """Print a table of node times and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--preset", default="standard")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    plate, glb = SAMPLES / "in.mp4", SAMPLES / "anim.glb"
    ratios, timings = [], []
    with tempfile.TemporaryDirectory() as folder:
        composite(plate, glb, Path(folder) / "warm.mp4", arguments.preset)
        for _ in range(arguments.rounds):
            plain = transcode(plate, Path(folder) / "plain.mp4")
            whole, timing = composite(plate, glb, Path(folder) / "out.mp4", arguments.preset)
            ratios.append(whole / plain)
            timings.append(timing)
    best = min(timings, key=lambda timing: timing.median_ms)
    print(f"{'node':14s} median ms (best of {arguments.rounds} rounds)")
    for node, elapsed_ms in best.node_median_ms.items():
        print(f"{node:14s} {elapsed_ms:8.2f}")
    print(f"{'all nodes':14s} {best.median_ms:8.2f}   p95 {best.p95_ms:.2f}")
    print(f"first frame with the fit: {best.first_frame_ms:.0f} ms")
    print(f"throughput: {max(timing.fps for timing in timings):.1f} fps, lanes overlapping")
    print(
        f"whole run / plain decode + encode: {statistics.median(ratios):.2f} "
        f"({min(ratios):.2f} to {max(ratios):.2f})"
    )


if __name__ == "__main__":
    main()
