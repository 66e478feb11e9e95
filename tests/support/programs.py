"""The real ffmpeg and ffprobe programs, for tests that put them on the other side."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path


def ffmpeg(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the ffmpeg program; it overwrites, and says errors only."""
    command = ["ffmpeg", "-v", "error", "-nostdin", "-y", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def made(*words: object) -> Path:
    """The file that the ffmpeg program makes of these words, whose last one names it."""
    run = ffmpeg(*words)
    assert run.returncode == 0, run.stderr
    return Path(str(words[-1]))


def streams(path: Path) -> list[dict[str, object]]:
    """What the ffprobe program says of a file's streams; nothing where it opens none."""
    command = ["ffprobe", "-v", "error", "-show_streams", "-of", "json", str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return json.loads(run.stdout or "{}").get("streams", []) if run.returncode == 0 else []


def codecs(path: Path) -> dict[str, str]:
    """Codecs of the first stream of each type."""
    found = reversed(streams(path))
    return {str(one["codec_type"]): str(one.get("codec_name", "none")) for one in found}


def complaints(path: Path) -> str:
    """What the ffmpeg program complains of when it decodes a whole file; nothing: all is well."""
    run = ffmpeg("-i", path, "-map", "0:v", "-map", "0:a?", "-f", "null", "-")
    return run.stderr.strip() or ("" if run.returncode == 0 else f"exit code {run.returncode}")
