"""A run of nlens-video in a process of its own; it knows nothing of Blender."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import tempfile
import threading
from pathlib import Path


def split_options(text: str) -> list[str]:
    """Words of options as a shell splits them; a backslash is a letter on Windows.

    Raises:
        ValueError: a quotation is not closed, or a backslash is the last letter.
    """
    lexer = shlex.shlex(text, posix=True)
    lexer.whitespace_split, lexer.commenters = True, ""
    if os.name == "nt":
        lexer.escape = ""
    try:
        return list(lexer)
    except ValueError as error:
        raise ValueError(f"options: {str(error).lower()} in {text}") from None


class Job:
    """A run that has begun.

    Args:
        program: nlens-video; empty for that on the PATH.
        plate: its input.
        glb: the object.
        result: its output, replaced.
        words: further options.
        folder: holds the object, and is removed when the run has ended.

    Raises:
        ValueError: the program is not there.
    """

    def __init__(
        self, program: str, plate: str, glb: Path, result: Path, words: list[str],
        folder: tempfile.TemporaryDirectory[str],
    ) -> None:  # fmt: skip
        found = program or shutil.which("nlens-video")
        if not found or not Path(found).exists():
            raise ValueError(
                "nlens-video is not on the PATH; name it in the add-on's preferences, or "
                "pip install nlens-video"
            )
        command = [found, plate, str(glb), str(result), *words, "-y", "--progress-lines"]
        # Blender's own settings of Python and OpenGL's libraries are not the program's
        inherited = {name: value for name, value in os.environ.items() if "PYTHON" not in name}
        self.result, self.percent, self.cancelled = result, 0, False
        self._lines: list[str] = []
        self._folder = folder
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            text=True, env=inherited,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stderr or ():
            try:
                told = json.loads(line)
                self.percent = round(100 * told["frames"] / told["of"])
            except (ValueError, KeyError, TypeError, ZeroDivisionError):
                self._lines.append(line.strip())
        self._process.wait()
        self._folder.cleanup()

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._process.poll() is not None and not self._reader.is_alive()

    @property
    def error(self) -> str:
        """The program's line, empty where it went well."""
        if not self._process.poll():
            return ""
        return self._lines[-1] if self._lines else f"exit code {self._process.returncode}"

    def wait(self) -> None:
        """Until it has ended."""
        self._process.wait()
        self._reader.join()

    def cancel(self) -> None:
        """Interrupt it; it removes what it has begun."""
        self.cancelled = True
        self._process.send_signal(signal.SIGINT)
