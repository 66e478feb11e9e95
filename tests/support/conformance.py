"""What every adapter must do: the frames, tags, times and errors of the command line.

A test module of an adapter says how its program composites a `Plate`, and runs `assert_conforms`
on each case that the program can hold, and `assert_same_errors`.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from msgspec.structs import replace
from support import shots
from support.folders import ROOT

from nlens_video.video.info import FrameTags

FRAMES, RATE = 6, 25
HDR = FrameTags(colorspace=9, color_range=1, color_primaries=9, color_trc=16)
VIDEO = FrameTags(colorspace=1, color_range=1, color_primaries=1, color_trc=1)
CASES = {
    "bt709": ("yuv420p", VIDEO),
    "full range": ("yuv444p", replace(VIDEO, color_range=2, color_trc=13)),
    "hdr": ("yuv422p10le", HDR),
    "rgb": ("gbrp10le", replace(VIDEO, colorspace=0, color_range=2, color_trc=13)),
    "packed": ("bgr0", replace(VIDEO, colorspace=0, color_range=2, color_trc=13)),
}
OPTIONS = {"preset": "realtime", "track_focus": "off"}
"""Of every adapter, beside `fit`; the words of the command line are the same."""


@dataclass(frozen=True)
class Plate:
    """A shot in FFV1, and what the command line makes of it as a stream.

    Attributes:
        folder: holds `in.mkv`, `anim.glb` and `fit.json`.
        pixel_format: FFmpeg's name.
        tags: of its frames.
    """

    folder: Path
    pixel_format: str
    tags: FrameTags

    @property
    def path(self) -> Path:
        return self.folder / "in.mkv"

    @property
    def glb(self) -> Path:
        return self.folder / "anim.glb"

    @property
    def fit(self) -> Path:
        return self.folder / "fit.json"

    def frames(self) -> list[av.VideoFrame]:
        return decoded(self.path)


@dataclass(frozen=True)
class Composited:
    """What an adapter made: planes (rows, samples) of each frame, their times [s], their tags."""

    planes: list[list[np.ndarray]]
    times: list[Fraction]
    tags: FrameTags | None = None


_UNKNOWN = "efects: not an option of a Compositor; did you mean effects?"

Adapter = Callable[[Plate, dict[str, object]], Composited]
"""Composites a plate with options of a `Compositor`; raises an error whose text is the line."""


def write_plate(folder: Path, case: str) -> Plate:
    """Make the files of a case."""
    pixel_format, tags = CASES[case]
    shots.cube_glb(folder / "anim.glb", end=(0.3, 0.0, -2.0), seconds=0.3)
    shots.fit_json(folder / "fit.json")
    rng = np.random.default_rng(3)
    with av.open(str(folder / "in.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = shots.WIDTH, shots.HEIGHT, pixel_format
        _tag(stream.codec_context, tags)
        for number in range(FRAMES):
            noisy = shots.plate() + rng.normal(0, 2.0, (shots.HEIGHT, shots.WIDTH, 3))
            noisy = np.clip(noisy, 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(noisy, "rgb24").reformat(
                format=pixel_format, dst_colorspace=1, dst_color_range=tags.color_range
            )
            _tag(frame, tags)
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return Plate(folder, pixel_format, tags)


def by_command_line(plate: Plate) -> Composited:
    """What the command line makes of the plate as a stream."""
    words = [f"--{name.replace('_', '-')}={value}" for name, value in OPTIONS.items()]
    out = plate.folder / "expected.mkv"
    run = command_line(plate, "-", plate.glb, out, "--fit", plate.fit, "--codec", "ffv1", *words)
    assert run.returncode == 0, run.stderr
    return of_frames(decoded(out))


def command_line(plate: Plate, *words: object) -> subprocess.CompletedProcess[str]:
    """Run the command line with the plate as its standard input."""
    with plate.path.open("rb") as source:
        return subprocess.run(
            [sys.executable, "-m", "nlens_video", *map(str, words), "-q"], stdin=source, cwd=ROOT,
            capture_output=True, text=True, check=False, timeout=120,
        )  # fmt: skip


def assert_conforms(adapter: Adapter, plate: Plate, expected: Composited) -> None:
    """The adapter's frames, times and tags are those of the command line."""
    made = adapter(plate, {**OPTIONS, "fit": plate.fit})
    assert made.times == expected.times
    untouched = of_frames(plate.frames()).planes
    assert len(made.planes) == len(expected.planes) == FRAMES
    for number, (mine, theirs) in enumerate(zip(made.planes, expected.planes, strict=True)):
        for one, other in zip(mine, theirs, strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"frame {number}")
        changed = [np.any(a != b) for a, b in zip(mine, untouched[number], strict=True)]
        assert any(changed), "the object is in view on every frame"
    if made.tags is not None:
        assert made.tags == plate.tags


def assert_same_errors(
    adapter: Adapter, plate: Plate, error: type[Exception], *, host_checks_names: bool = False
) -> None:
    """What the command line refuses, the adapter refuses by the same words.

    Where the host checks the names of options itself, the words are its own.
    """
    broken = plate.folder / "broken.glb"
    broken.write_bytes(b"no glTF")
    told = command_line(plate, "-", broken, plate.folder / "none.mkv", "--fit", plate.fit)
    assert told.returncode == 4
    (line,) = told.stderr.strip().splitlines()
    for given, said in (
        ({"glb": broken}, line.split(": ", 1)[1]),
        ({"preset": "fast"}, "fast"),
        ({"shadow_strength": 3.0}, "shadow_strength="),
        ({"efects": "none"}, "efects" if host_checks_names else _UNKNOWN),
    ):
        try:
            adapter(plate, {**OPTIONS, "fit": plate.fit, **given})
        except error as failed:
            assert said in str(failed)
        else:
            raise AssertionError(f"{given} was accepted")


def decoded(path: Path) -> list[av.VideoFrame]:
    with av.open(str(path)) as container:
        return list(container.decode(video=0))


def of_frames(frames: list[av.VideoFrame]) -> Composited:
    """Frames of PyAV in the form in which adapters give theirs."""
    return Composited(
        [planes_of(frame) for frame in frames],
        [(frame.pts - frames[0].pts) * frame.time_base for frame in frames],
        FrameTags(**{name: getattr(frames[0], name) for name in FrameTags.__struct_fields__}),
    )


def planes_of(frame: av.VideoFrame) -> list[np.ndarray]:
    """Copies of a frame's planes, without the padding of their rows."""
    parts, found = frame.format.components, []
    for number, plane in enumerate(frame.planes):
        rows = np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)
        rows = rows.view(np.uint16 if parts[0].bits > 8 else np.uint8)
        here = sum(part.plane == number for part in parts)
        of_pixel = {"yuyv422": 2, "yvyu422": 2, "uyvy422": 2, "bgr0": 4}.get(
            frame.format.name, here
        )
        found.append(rows[:, : plane.width * of_pixel].copy())
    return found


def _tag(target: object, tags: FrameTags) -> None:
    for name in FrameTags.__struct_fields__:
        setattr(target, name, getattr(tags, name))
