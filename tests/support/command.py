"""The command line as tests call it: in this process, or in one of its own."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from types import SimpleNamespace

from nlens_video.cli.main import main


def nlens(*words: object) -> SimpleNamespace:
    """Run the command line in this process; returns its exit code and what it printed."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def process(*words: object, **options: object) -> subprocess.Popen[bytes]:
    """Start the command line in a process of its own, with its standard error in a pipe."""
    command = [sys.executable, "-m", "nlens_video", *map(str, words)]
    return subprocess.Popen(command, **{"stderr": subprocess.PIPE, **options})


def one_line(run: SimpleNamespace, code: int) -> str:
    """Assert that a run ended with `code` and one line of error; returns the line."""
    text = run.stderr.strip()
    assert run.returncode == code, text
    assert text.startswith("nlens-video: ") and "\n" not in text, text
    return text
