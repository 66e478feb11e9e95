"""Time of the adapters beside the plain pipe, on the same raw frames of the demo.

`python benchmarks/bench_adapters.py` prints a table: frames a second of the whole run with its
start, milliseconds of a frame after the first, and their ratio to the pipe's: the best of three
rounds, in each of which every adapter runs once. GStreamer is left out where the element is not
installed (docs/gstreamer.md), VapourSynth where its module is not.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

import av
import numpy as np

from nlens_video import Compositor, FrameQueue
from nlens_video.adapters import contract
from nlens_video.video.info import FrameTags

ROOT = Path(__file__).resolve().parents[1]
PLATE, GLB = ROOT / "samples" / "in.mp4", ROOT / "samples" / "anim.glb"
OPTIONS = {"preset": "realtime", "track_focus": "off"}
TAGS = FrameTags(colorspace=1, color_range=1, color_primaries=1, color_trc=1)
SIZE, RATE, ROUNDS = (960, 512), 24, 3
Planes = tuple[np.ndarray, ...]


def frames() -> Iterator[av.VideoFrame]:
    """The demo's plate, decoded."""
    with av.open(str(PLATE)) as container:
        yield from container.decode(video=0)


def main() -> None:
    """Measure, and print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pictures = [frame.to_ndarray() for frame in frames()]
        np.concatenate(pictures).tofile(folder / "in.yuv")
        fit = folder / "fit.json"
        with Compositor(GLB, **OPTIONS, fps=RATE) as lens:
            lens.process(next(frames()).to_ndarray(format="bgr24"), 0.0)
            fit.write_text(lens.fit.to_json())
        print(f"{len(pictures)} frames of {SIZE[0]}x{SIZE[1]}, preset realtime, a known lens\n")
        print("| adapter | frames/s, start included | ms a frame after the first | by the pipe |")
        print("| --- | --- | --- | --- |")
        runs: dict[str, Callable[[], float]] = {
            "pipe: nlens-video - anim.glb -": lambda: pipe(folder, fit),
            "contract, in place": lambda: in_place(pictures, fit),
            "Compositor.process (BGR)": lambda: loop(fit),
            "FrameQueue (BGR), decoding beside it": lambda: queued(fit),
        }
        if shutil.which("gst-inspect-1.0") and not _silent("gst-inspect-1.0", "nlens"):
            runs["GStreamer, nlens"] = lambda: gstreamer(folder, fit)
        if importlib.util.find_spec("vapoursynth") is not None:
            runs["VapourSynth, composite"] = lambda: vapoursynth(pictures, fit)
        rates: dict[str, list[float]] = {label: [] for label in runs}
        steadies: dict[str, list[float]] = {label: [] for label in runs}
        for label, run in [*runs.items()] * ROUNDS:
            start = time.perf_counter()
            steadies[label].append(run())
            rates[label].append(len(pictures) / (time.perf_counter() - start))
        pipe_ms = min(next(iter(steadies.values())))
        for label, found in steadies.items():
            print(
                f"| {label} | {max(rates[label]):.1f} | {min(found):.1f} "
                f"| {min(found) / pipe_ms:.2f} |"
            )


def _silent(*command: object) -> int:
    return subprocess.run(
        [str(word) for word in command], capture_output=True, check=False
    ).returncode


def steady(times: list[float]) -> float:
    """Milliseconds a frame took, without the first."""
    return 1e3 * (times[-1] - times[1]) / (len(times) - 2)


def pipe(folder: Path, fit: Path) -> float:
    """Raw frames in and out of the command line."""
    command = [
        sys.executable, "-m", "nlens_video", "-", str(GLB), "-", "--preset", "realtime", "--fit",
        str(fit), "--track-focus", "off", "--input-format", "yuv420p",
        "--input-size", f"{SIZE[0]}x{SIZE[1]}", "--input-rate", str(RATE), "-q",
    ]  # fmt: skip
    return arrivals(command, SIZE[0] * SIZE[1] * 3 // 2, folder / "in.yuv")


def arrivals(command: list[str], size: int, given: Path | None = None) -> float:
    """Milliseconds from frame to frame in a command's output of frames of `size` bytes."""
    at = []
    source = given.open("rb") if given else nullcontext(subprocess.DEVNULL)
    with source as stdin, subprocess.Popen(command, stdin=stdin, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        while process.stdout.read(size):
            at.append(time.perf_counter())
    assert process.returncode == 0
    return steady(at)


def in_place(pictures: list[np.ndarray], fit: Path) -> float:
    """The contract on frames in memory."""
    (width, height), at = SIZE, []
    lens = contract.open(GLB, **OPTIONS, fit=fit, fps=RATE)
    for number, picture in enumerate(pictures):
        rows = picture.reshape(-1)
        luma = width * height
        planes = tuple(
            rows[first : first + length].reshape(-1, columns)
            for first, length, columns in (
                (0, luma, width),
                (luma, luma // 4, width // 2),
                (luma + luma // 4, luma // 4, width // 2),
            )
        )
        asked = contract.Frame(
            pixel_format="yuv420p", width=width, height=height, planes=planes, tags=TAGS,
            time_s=number / RATE, number=number,
        )  # fmt: skip
        contract.process(lens, asked)
        at.append(time.perf_counter())
    contract.close(lens)
    return steady(at)


def loop(fit: Path) -> float:
    """A loop that decodes, converts to BGR and composites."""
    at = []
    with Compositor(GLB, **OPTIONS, fit=fit, fps=RATE) as lens:
        for frame in frames():
            picture = frame.to_ndarray(format="bgr24")
            lens.process(picture, out=picture)
            at.append(time.perf_counter())
    return steady(at)


def queued(fit: Path) -> float:
    """The same with the decoding beside the compositing."""
    at = []
    with Compositor(GLB, **OPTIONS, fit=fit, fps=RATE) as lens, FrameQueue(lens, 3) as queue:
        for frame in frames():
            picture = frame.to_ndarray(format="bgr24")
            if len(queue) == 3:
                queue.result()
                at.append(time.perf_counter())
            queue.submit(picture, None, picture)
        while len(queue):
            queue.result()
            at.append(time.perf_counter())
    return steady(at)


def gstreamer(folder: Path, fit: Path) -> float:
    """gst-launch-1.0 from the raw file to a pipe."""
    caps = f"video/x-raw,format=I420,width={SIZE[0]},height={SIZE[1]},framerate={RATE}/1"
    size = SIZE[0] * SIZE[1] * 3 // 2
    command = [
        "gst-launch-1.0", "-q", "filesrc", f"location={folder}/in.yuv", f"blocksize={size}", "!",
        f"{caps},colorimetry=bt709", "!", "queue", "!", "rawvideoparse", "use-sink-caps=true", "!",
        "nlens", f"glb={GLB}", f"fit={fit}", "preset=realtime", "track-focus=off", "!", "fdsink",
    ]  # fmt: skip
    return arrivals(command, size)


def vapoursynth(pictures: list[np.ndarray], fit: Path) -> float:
    """The filter behind a clip of frames in memory."""
    import vapoursynth as vs

    from nlens_video.vapoursynth import composite

    clip = vs.core.std.BlankClip(
        format=vs.YUV420P8, width=SIZE[0], height=SIZE[1], length=len(pictures), fpsnum=RATE
    ).std.SetFrameProps(_Matrix=1, _Transfer=1, _Primaries=1, _Range=0)
    luma = SIZE[0] * SIZE[1]

    def filled(n: int, f: vs.VideoFrame) -> vs.VideoFrame:
        made, rows = f.copy(), pictures[n].reshape(-1)
        for plane, first in enumerate((0, luma, luma + luma // 4)):
            target = np.asarray(made[plane])
            target[...] = rows[first : first + target.size].reshape(target.shape)
        return made

    made = composite(clip.std.ModifyFrame(clips=clip, selector=filled), GLB, **OPTIONS, fit=fit)
    at = []
    for frame in made.frames(close=True):
        assert frame.width == SIZE[0]
        at.append(time.perf_counter())
    return steady(at)


if __name__ == "__main__":
    main()
