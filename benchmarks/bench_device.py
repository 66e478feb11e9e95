"""The CPU beside a GPU: the scatter, then whole runs of the sample enlarged to 1080p and 4K.

    python benchmarks/bench_device.py [--device cuda] [--frames N] [--heights N,N] [--presets NAME]

The reblur and its networks are what `--device` moves; all else is the CPU's. Both devices blur the
same layers and composite the same frames in turn; how far their pictures differ stands beside.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from bench_demo import SAMPLES
from bench_scatter import least_ms

from nlens_video.cli.main import main as command
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.networks.device import choose

DISCS_PX = (4, 16, 64)


def print_scatter(device: str, heights: list[int]) -> None:
    """A layer that covers a third of the frame each way, by both devices."""
    spread = choose(device).spread
    print(f"{'layer':>11}  CoC [px]  cpu [ms]  {device} [ms]  largest difference")
    for height in heights:
        for disc in DISCS_PX:
            margin = disc
            shape = (height // 3 + 2 * margin, height * 16 // 27 + 2 * margin)
            rgba = np.zeros((*shape, 4), np.float32)
            rgba[margin:-margin, margin:-margin] = np.random.default_rng(0).random(
                (shape[0] - 2 * margin, shape[1] - 2 * margin, 4), np.float32
            )
            rows = np.linspace(disc / 2, disc, shape[0], dtype=np.float32)
            coc = np.repeat(rows[:, None], shape[1], axis=1)
            off = np.abs(scatter(rgba, coc) - scatter(rgba, coc, spread=spread)).max()
            here = least_ms(lambda rgba=rgba, coc=coc: scatter(rgba, coc), 5)
            there = least_ms(lambda rgba=rgba, coc=coc: scatter(rgba, coc, spread=spread), 5)
            size = f"{shape[1]}x{shape[0]}"
            print(f"{size:>11}  {disc:8d}  {here:8.1f}  {there:9.1f}  {off:.1e}", flush=True)


def enlarged(height: int, frames: int, path: Path) -> Path:
    """The first frames of the sample's plate at another size, a whole multiple of 32 wide."""
    with av.open(str(SAMPLES / "in.mp4")) as given, av.open(str(path), "w") as made:
        source = given.streams.video[0]
        stream = made.add_stream("libx264", rate=Fraction(24), options={"preset": "veryfast"})
        width = round(height * source.width / source.height / 32) * 32
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for index, frame in enumerate(given.decode(video=0)):
            if index >= frames:
                break
            picture = cv2.resize(
                frame.to_ndarray(format="rgb24"), (width, height), interpolation=cv2.INTER_CUBIC
            )
            made.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        made.mux(stream.encode())
    return path


def composited(
    plate: Path, preset: str, effects: str, device: str
) -> tuple[dict[str, float], np.ndarray]:
    """Median ms of each node and of a frame, and the last frame (H, W, 3)."""
    out, timings = plate.with_name("out.mp4"), plate.with_name("timings.json")
    words = [plate, SAMPLES / "anim.glb", out, "--preset", preset, "--effects", effects]
    words += ["--device", device, "--timings", timings, "--no-progress", "-q", "-y", "--crf", "1"]
    if code := command([str(word) for word in words]):
        sys.exit(f"the run ended with {code}")
    told = json.loads(timings.read_text())["summary"]
    nodes = {"frame": told["median_ms"], **told["node_median_ms"]}
    with av.open(str(out)) as made:
        *_, last = made.decode(video=0)
    return nodes, last.to_ndarray(format="rgb24")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--heights", default="512,1080,2160")
    parser.add_argument("--presets", default="realtime,standard")
    parser.add_argument("--effects", default="auto")
    words = parser.parse_args()
    heights = [int(height) for height in words.heights.split(",")]
    print_scatter(words.device, heights)
    for height in heights:
        with tempfile.TemporaryDirectory() as name:
            plate = enlarged(height, words.frames, Path(name) / "plate.mp4")
            for preset in words.presets.split(","):
                pictures = []
                for device in ("cpu", words.device):
                    nodes, picture = composited(plate, preset, words.effects, device)
                    pictures.append(picture)
                    listed = ", ".join(
                        f"{node} {ms:.1f}"
                        for node, ms in sorted(nodes.items(), key=lambda one: -one[1])[:8]
                    )
                    print(f"{picture.shape[1]}x{height} {preset} {device}: ms {listed}", flush=True)
                print(f"  PSNR between them {cv2.PSNR(*pictures):.1f} dB", flush=True)


if __name__ == "__main__":
    main()
