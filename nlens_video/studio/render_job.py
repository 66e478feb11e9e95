"""Rendering the saved shot: the command line itself, in a process of its own."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nlens_video.core.errors import OutputError, UsageError

_PATIENCE_S = 10.0
_COMPLETE = re.compile(r"interrupted; (.*) is complete")
Tell = Callable[[dict[str, Any]], None]


class ResultExistsError(OutputError):
    """The file of the result is there, and no render of this studio has written it."""


class RenderJob:
    """Renders a shot file, one at a time.

    Args:
        tell: told of its progress and its end, from another thread.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._process: subprocess.Popen[str] | None = None
        self._gate = threading.Lock()
        self._cancelled = False
        self._last: dict[str, Any] = {"render": "none"}
        self._target: Path | None = None
        self._written: dict[Path, tuple[int, int]] = {}  # results, as they were left

    @property
    def last(self) -> dict[str, Any]:
        """What was told last."""
        return self._last

    @property
    def result(self) -> Path | None:
        """The file that the last render has written; None where it ended without."""
        return self._target if self._last["render"] == "done" else None

    def check_target(self, target: Path) -> None:
        """Check that a result replaces nothing but what a render of this studio has written.

        Raises:
            ResultExistsError: it would.
        """
        if target.exists() and self._written.get(target) != _state(target):
            raise ResultExistsError(f"{target.name} exists, and this studio has not rendered it")

    def check_free(self) -> None:
        """Check that none runs.

        Raises:
            UsageError: one does.
        """
        if self._process is not None:
            raise UsageError("the shot is being rendered already")

    def start(self, shot: Path, target: Path | None) -> None:
        """Start `nlens-video SHOT.toml`.

        Args:
            shot: the file.
            target: the file of its result, which is replaced; None where that is no file.

        Raises:
            UsageError: it runs already.
        """
        with self._gate:
            self.check_free()
            self._cancelled, self._target = False, target
            self._process = subprocess.Popen(
                [sys.executable, "-m", "nlens_video", str(shot), "-y", "--json",
                 "--progress-lines"],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                text=True, errors="replace", start_new_session=True,
            )  # fmt: skip
            self._say({"render": "running", "what": "starting", "frames": 0, "of": None})
            threading.Thread(target=self._follow, args=(self._process,), daemon=True).start()

    def cancel(self) -> None:
        """Interrupt it, as Ctrl-C does; it leaves no result."""
        with self._gate:
            process = self._process
            self._cancelled = process is not None
        if process is not None:
            process.send_signal(signal.SIGINT)

    def close(self) -> None:
        """Cancel, and wait for the end of the process; one that does not end is killed."""
        self.cancel()
        process = self._process
        if process is None:
            return
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _follow(self, process: subprocess.Popen[str]) -> None:
        """Tell of its progress, and at last how it ended."""
        out, errors = process.stdout, process.stderr
        assert out is not None
        assert errors is not None
        results: list[str] = []
        reader = threading.Thread(target=lambda: results.append(out.read()))
        reader.start()
        said = ""
        for line in errors:
            told = _progress(line)
            if told is not None:
                self._say({"render": "running", **told})
            elif line.startswith("nlens-video: "):
                said = line.removeprefix("nlens-video: ").strip()
        reader.join()
        code = process.wait()
        with self._gate:
            self._process = None
        complete = _COMPLETE.fullmatch(said)  # interrupted too late
        if (code == 0 or complete) and self._target is not None and self._target.is_file():
            self._written[self._target] = _state(self._target)
        if code == 0:
            self._say({"render": "done", **_result(results[0])})
        elif complete:
            self._say({"render": "done", "output": complete[1], "frames": 0, "notes": []})
        elif self._cancelled:
            self._say({"render": "cancelled"})
        else:
            self._say({"render": "failed", "error": said or f"it ended with the code {code}"})

    def _say(self, said: dict[str, Any]) -> None:
        self._last = said
        self._tell(said)


def _state(path: Path) -> tuple[int, int]:
    """Time of its last change [ns] and size [bytes]."""
    now = path.stat()
    return now.st_mtime_ns, now.st_size


def _progress(line: str) -> dict[str, Any] | None:
    if not line.startswith('{"progress"'):
        return None
    try:
        told = json.loads(line)
    except ValueError:
        return None
    return {"what": told["progress"], "frames": told["frames"], "of": told["of"]}


def _result(text: str) -> dict[str, Any]:
    """What the page shows of the summary."""
    try:
        summary = json.loads(text)
    except ValueError:
        return {"notes": []}
    timing = summary.get("timing", {})
    return {
        "notes": summary.get("notes", []),
        "output": summary.get("output"),
        "frames": timing.get("frames"),
        "fps": timing.get("fps"),
        "within_budget": timing.get("within_budget"),
    }
