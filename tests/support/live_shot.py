"""A small shot, and a run on it by the command line with whole programs on both sides."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

from support import shots
from support.folders import ROOT

FRAMES = 12
RUN = f"{sys.executable} -m nlens_video"
QUICK = "--preset draft --fit fit.json -q"


def write_shot(folder: Path) -> Path:
    """`in.mp4` (with sound), `in.mkv`, `anim.glb` and `fit.json` in a folder; returns it."""
    shots.write_video(folder / "in.mp4", frames=FRAMES)
    shots.write_video(folder / "in.mkv", frames=FRAMES)
    shots.cube_glb(folder / "anim.glb", end=(0.1, 0.0, -1.6))
    shots.fit_json(folder / "fit.json")
    return folder


def shell(
    command: str, folder: Path, *, timeout: float = 120
) -> subprocess.CompletedProcess[bytes]:
    """Run a line of Bash, in which `nlens-video` is this package's; any part's failure counts."""
    script = f'set -o pipefail; nlens-video() {{ {RUN} "$@"; }}; {command}'
    return subprocess.run(
        ["bash", "-c", script], cwd=folder, capture_output=True, check=False, timeout=timeout,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def succeeded(command: str, folder: Path, *, timeout: float = 120) -> str:
    """Run a line as `shell`, assert that it went well; what it wrote to standard error."""
    run = shell(command, folder, timeout=timeout)
    words = run.stderr.decode()
    assert run.returncode == 0, words
    assert "Traceback" not in words, words
    return words


def streams(path: Path) -> list[dict[str, object]]:
    """What the `ffprobe` program says of each stream, its packets counted."""
    command = ["ffprobe", "-v", "error", "-show_streams", "-count_packets", "-of", "json", path]
    found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    return list(found["streams"])


def pictures(path: Path) -> tuple[str, int]:
    """The video stream's codec and number of pictures, by `ffprobe`."""
    (video,) = (one for one in streams(path) if one["codec_type"] == "video")
    return str(video["codec_name"]), int(str(video["nb_read_packets"]))


def picture_times(path: Path) -> list[Fraction]:
    """When each picture is shown, counted from the first one, by `ffprobe` [s]."""
    command = ["ffprobe", "-v", "error", "-select_streams", "v", "-of", "json", "-show_entries",
               "packet=pts:stream=time_base", path]  # fmt: skip
    found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    unit = Fraction(found["streams"][0]["time_base"])
    times = sorted(packet["pts"] * unit for packet in found["packets"])
    return [time - times[0] for time in times]
