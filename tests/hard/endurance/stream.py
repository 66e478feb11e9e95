"""Streams of many small frames: what drifts, and by how much.

python tests/hard/endurance/stream.py 100000 docs/hard/endurance.json   the long run, recorded
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

import av
import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
from support import shots

from nlens_video import Compositor
from nlens_video.core.objects import Playback
from nlens_video.core.settings import ObjectSettings

SIZE = (160, 90)
FPS, PERIOD_S = 32, 2.0  # moments that floats hold exactly: the object is back every 64 frames
TICK = 1001  # of a time base of 1 / 30000
SAMPLES = 100  # of the memory, over a run


def memory_mb(process: int | str = "self") -> float:
    """What a process holds in memory; 0 for one that has just ended."""
    held = Path(f"/proc/{process}/status").read_text().partition("VmRSS:")[2].split()
    return int(held[0]) / 1024 if held else 0.0


def thinned(samples: list[float]) -> list[float]:
    """About `SAMPLES` of them, to a tenth."""
    return [round(one, 1) for one in samples[:: max(1, len(samples) // SAMPLES)]]


def growth_mb(samples: list[float]) -> float:
    """How much more the last fifth of a run holds than its second fifth."""
    fifth = max(1, len(samples) // 5)
    return float(np.median(samples[-fifth:]) - np.median(samples[fifth : 2 * fifth]))


def loop(frames: int) -> dict[str, object]:
    """A loop of noisy frames through the live `Compositor`: lens, pictures and memory over time.

    Every 64th frame shows the same moment and the same plate without noise, so that its composite
    must be the same to the bit.
    """
    clean = cv2.resize(shots.plate()[..., ::-1], SIZE, interpolation=cv2.INTER_AREA)
    rng = np.random.default_rng(0)
    grain = [rng.normal(0, 2.0, clean.shape) for _ in range(7)]
    noisy = [np.clip(clean + one, 0, 255).astype(np.uint8) for one in grain]
    again, memory, slopes, every = [], [], [], max(1, frames // SAMPLES)
    round_trip = int(FPS * PERIOD_S)
    with tempfile.TemporaryDirectory() as folder:
        glb = shots.cube_glb(Path(folder) / "a.glb", end=(0.3, 0, -2.6), seconds=PERIOD_S)
        played = ObjectSettings(glb=glb, playback=Playback(loop=True))
        with Compositor(played, preset="realtime", fps=FPS) as lens:
            for index in range(frames):
                same = index % round_trip == 0
                seen = lens.process(clean if same else noisy[index % 7])
                if same:
                    again.append(zlib.crc32(seen.tobytes()))
                if index % every == 0:
                    memory.append(memory_mb())
                    slopes.append(lens.fit.slope)
    return {
        "frames": frames,
        "rounds": len(again),
        "rounds that differ": sum(one != again[0] for one in again),
        "slope drift": float(np.ptp(slopes) / slopes[0]),
        "memory": memory,
    }


def file(frames: int) -> dict[str, object]:
    """A file of 30000/1001 frames a second through the command line: times and memory."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shots.cube_glb(folder / "a.glb", end=(0.3, 0.0, -2.6), seconds=10.0)
        shots.fit_json(folder / "fit.json", *SIZE)
        words = [
            f"testsrc2=size={SIZE[0]}x{SIZE[1]}:rate=30000/1001", folder / "a.glb",
            folder / "out.mp4", "--input-format", "lavfi", "--range", f"0:{frames}",
            "--fit", folder / "fit.json", "--preset", "realtime", "-q", "--no-progress",
        ]  # fmt: skip
        command = [sys.executable, "-m", "nlens_video", *map(str, words)]
        memory, pause = [], min(1.0, frames / 20_000)
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
            while running.poll() is None:
                memory.append(memory_mb(running.pid))
                time.sleep(pause)
            said = running.stderr.read() if running.stderr else ""
        if running.returncode:
            raise RuntimeError(said)
        with av.open(str(folder / "out.mp4")) as container:
            stream = container.streams.video[0]
            times = sorted(
                float(packet.pts * stream.time_base * 30000)
                for packet in container.demux(stream)
                if packet.pts is not None
            )
    off = np.abs(np.array(times) - times[0] - TICK * np.arange(len(times)))
    started = [one for one in memory if one > 0.5 * max(memory)]
    return {"frames": len(times), "ticks off": float(off.max()), "memory": started}


def main() -> None:
    """Run both for so many frames, and record what came of it."""
    frames, path = int(sys.argv[1]), Path(sys.argv[2])
    start = time.process_time()
    record = {"loop": loop(frames), "file": file(frames)}
    for run in record.values():
        run["memory"] = thinned(run["memory"])
    path.write_text(json.dumps(record) + "\n")
    print(f"{time.process_time() - start:.0f} s of processor time in the loop")


if __name__ == "__main__":
    main()
