"""A minute in twelve chunks on several workers, one of them killed midway, against a single run.

    python benchmarks/farm_kill.py [--workers N] [--preset NAME]

The demo's plate, ten times over, with its object. Both results are FFV1 and compared frame by
frame: times and every sample. A worker is killed (`kill -9`) once seven pieces of chunks are there.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

SAMPLES = Path(__file__).parents[1] / "samples"
TURNS, CHUNK_S, KILL_AFTER = 10, 5.0, 7


def long_plate(path: Path, turns: int = TURNS) -> int:
    """The demo's plate so many times over, encoded anew, with its sound; the number of frames."""
    frames = sounds = 0
    with av.open(str(path), "w") as made:
        video = made.add_stream("libx264", 24, {"crf": "16", "preset": "veryfast"})
        video.width, video.height, video.pix_fmt = 960, 512, "yuv420p"
        tones = None
        for _ in range(turns):
            with av.open(str(SAMPLES / "in.mp4")) as given:
                if tones is None:
                    tones = made.add_stream_from_template(given.streams.audio[0])
                for packet in given.demux(given.streams.video[0], given.streams.audio[0]):
                    if packet.stream.type == "audio":
                        if packet.dts is not None:
                            packet.pts = packet.dts = sounds
                            sounds += packet.duration or 0
                            packet.stream = tones
                            made.mux(packet)
                        continue
                    for frame in packet.decode():
                        frame.pts, frame.time_base, frame.pict_type = frames, Fraction(1, 24), 0
                        made.mux(video.encode(frame))
                        frames += 1
        made.mux(video.encode(None))
    return frames


def different(first: Path, second: Path) -> int:
    """Frames of two files whose times or samples differ, or that only one of them has."""
    count = 0
    with av.open(str(first)) as one, av.open(str(second)) as other:
        for a, b in zip(one.decode(video=0), other.decode(video=0), strict=True):
            planes = zip(a.planes, b.planes, strict=True)
            same = all(np.array_equal(np.asarray(p), np.asarray(q)) for p, q in planes)
            count += not same or a.pts * a.time_base != b.pts * b.time_base
    return count


def farm(words: list[str], chunks: Path, workers: int) -> tuple[float, int]:
    """Run a farm and kill a worker while it writes; seconds, and the process that was killed."""
    start, killed = time.perf_counter(), 0
    command = [*words, "--workers", str(workers), "--chunk", str(CHUNK_S), "--chunks", str(chunks)]
    run = subprocess.Popen([sys.executable, "-m", "nlens_video", "farm", *command])
    while run.poll() is None:
        names = [one.name for one in chunks.iterdir()] if chunks.is_dir() else []
        writing = [m for name in names if (m := re.search(r"partial-\w+-(\d+)\.nut$", name))]
        if not killed and len(names) - len(writing) > KILL_AFTER and writing:
            killed = int(writing[-1][1])
            os.kill(killed, signal.SIGKILL)
        time.sleep(0.02)
    if run.returncode:
        raise SystemExit(f"the farm failed ({run.returncode})")
    return time.perf_counter() - start, killed


def main() -> None:
    """Print the figures; the exit code tells whether the results are equal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=3)
    parser.add_argument("--preset", default="standard")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        frames = long_plate(folder / "in.mp4")
        ran = ["--loop", "--preset", asked.preset, "--codec", "ffv1", "-q", "--no-progress"]
        given = [str(folder / "in.mp4"), str(SAMPLES / "anim.glb")]
        start = time.perf_counter()
        direct = [*given, str(folder / "direct.mkv"), *ran]
        subprocess.run([sys.executable, "-m", "nlens_video", *direct], check=True)
        direct_s = time.perf_counter() - start
        words = [*given, str(folder / "farm.mkv"), *ran]
        farm_s, killed = farm(words, folder / "chunks", asked.workers)
        made = len(list((folder / "chunks").glob("[!.]*.nut")))
        bytes_ = sum(one.stat().st_size for one in (folder / "chunks").glob("[!.]*.nut"))
        wrong = different(folder / "direct.mkv", folder / "farm.mkv")
    print(
        f"{frames} frames, {made} pieces of chunks ({bytes_ / frames / 1e3:.0f} kB a frame), "
        f"{asked.workers} workers, one killed: {'yes' if killed else 'NO'}; frames that differ: "
        f"{wrong}; direct {direct_s:.0f} s, farm {farm_s:.0f} s"
    )
    raise SystemExit(bool(wrong) or not killed)


if __name__ == "__main__":
    main()
