"""What effects cost that a scene does not call for, and an object that is out of view.

    python benchmarks/bench_effects.py [--rounds N]

Processor and elapsed time of a frame, in turn, after the first ones, in which kernels are still
being loaded: a shot that calls for defocus alone with `--effects auto` and with `--effects
defocus`; and an object out of view against plain decode + encode, of the sample's clip and of one
still picture, which costs the codec next to nothing.
"""

from __future__ import annotations

import argparse
import json
import statistics
import struct
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from bench_demo import SAMPLES, transcode
from msgspec.structs import replace

from nlens_video.core.objects import Playback
from nlens_video.core.settings import (
    LightSettings,
    ObjectSettings,
    OutputSettings,
    Settings,
    SourceSettings,
)
from nlens_video.run import render as run_render
from nlens_video.run.render import OnProgress

Spent = tuple[float, float]
FIRST, FRAMES, RATE = 64, 144, 24
SLOW = 0.02  # of its own pace: the object moves, by less than a pixel while the shutter is open


def clean_plate(path: Path) -> None:
    """A shot without noise, drift or motion: a frame of the sample, pressed hard in quality."""
    with av.open(str(SAMPLES / "in.mp4")) as clip:
        first = next(clip.decode(video=0)).to_ndarray(format="bgr24")
    still = cv2.bilateralFilter(first, 5, 8, 2)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=RATE, options={"crf": "8", "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = first.shape[1], first.shape[0], "yuv420p"
        picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(still), "bgr24").reformat(
            format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
        )
        for number in range(FRAMES):
            picture.pts, picture.time_base = number, Fraction(1, RATE)
            out.mux(stream.encode(picture))
        out.mux(stream.encode())


def moved_away(glb: Path) -> Path:
    """The sample's object a kilometre to the side of its camera, written to a file."""
    whole = (SAMPLES / "anim.glb").read_bytes()
    (length,) = struct.unpack_from("<I", whole, 12)
    content = json.loads(whole[20 : 20 + length])
    nodes = content["nodes"]
    roots = content["scenes"][content.get("scene", 0)]["nodes"]
    for root in roots:
        if "camera" not in nodes[root]:
            x, y, z = nodes[root].get("translation", (0.0, 0.0, 0.0))
            nodes[root]["translation"] = [x + 1000.0, y, z]
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = whole[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    glb.write_bytes(head + text + rest)
    return glb


def frame_s(run: Callable[[OnProgress], object]) -> Spent:
    """What a frame costs, without what is done once: (processor time, elapsed time) [s]."""
    marks: list[Spent] = []

    def mark(done: int, _: int | None) -> None:
        if done in (FIRST, FRAMES):
            marks.append((time.process_time(), time.perf_counter()))

    run(mark)
    (processor, elapsed), (processor_then, elapsed_then) = marks
    count = FRAMES - FIRST
    return (processor_then - processor) / count, (elapsed_then - elapsed) / count


def composited(run: Settings) -> Callable[[OnProgress], object]:
    """A run that tells how far it is."""
    return lambda on_progress: run_render.render(run, on_progress)


def main() -> None:
    """Print both ratios, and what was called for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plate, out = folder / "plate.mp4", folder / "out.mp4"
        clean_plate(plate)
        auto = Settings(
            source=SourceSettings(spec=str(plate)),
            scene=ObjectSettings(
                glb=SAMPLES / "anim.glb",
                playback=Playback(speed=SLOW),
                light=LightSettings(shadow_strength=0.0),
            ),
            output=OutputSettings(spec=str(out)),
            track_focus="off",
        )
        alone = replace(auto, effects="defocus")
        away = replace(
            auto,
            source=SourceSettings(spec=str(SAMPLES / "in.mp4")),
            scene=ObjectSettings(glb=moved_away(folder / "away.glb")),
        )
        away_still = replace(away, source=auto.source)
        # a shot that never shows its object is refused; here its cost is measured
        for check in ("check_shot", "check_written"):
            setattr(run_render, check, lambda *_, **__: None)
        outcome = run_render.render(auto)
        wanted = [one.effect for one in outcome.decisions if one.wanted]
        print(f"decided on, some of them frame by frame: {', '.join(wanted)}")
        print(f"object out of view: {run_render.render(away).composited} frames changed")
        for words, first, second in (
            ("auto / defocus alone", composited(auto), composited(alone)),
            (
                "out of view / decode + encode, the sample",
                composited(away),
                lambda on_progress: transcode(SAMPLES / "in.mp4", out, on_progress),
            ),
            (
                "out of view / decode + encode, a still picture",
                composited(away_still),
                lambda on_progress: transcode(plate, out, on_progress),
            ),
        ):
            pairs = [(frame_s(first), frame_s(second)) for _ in range(rounds)]
            plain_ms = 1e3 * statistics.median(other[1] for _, other in pairs)
            for at, kind in enumerate(("processor", "elapsed")):
                ratios = [one[at] / other[at] for one, other in pairs]
                print(
                    f"{words}, {kind}: {statistics.median(ratios):.3f} "
                    f"({min(ratios):.3f} to {max(ratios):.3f}), {plain_ms:.1f} ms being 1"
                )


if __name__ == "__main__":
    main()
