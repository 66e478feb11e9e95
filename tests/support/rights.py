"""The command line without rights of its own: root's power over all files is taken from it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from types import SimpleNamespace

_POWERS = "-dac_override,-dac_read_search,-fowner,-chown"
_PROGRAM = """
import contextlib, io, json, sys
from nlens_video.cli.main import main
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    sys.__stdout__.write(json.dumps([code, out.getvalue(), err.getvalue()]) + "\\n")
"""


def ordinary(*lines: Sequence[object], **options: object) -> list[SimpleNamespace]:
    """Run command lines, one after the other, in a process for which the rights of files count.

    Root keeps its name and loses its power over files, so that the Python of the tests can be run
    wherever it lies; anybody else is ordinary already.
    """
    command = [sys.executable, "-c", _PROGRAM, json.dumps([list(map(str, one)) for one in lines])]
    if os.geteuid() == 0:
        setpriv = shutil.which("setpriv")
        assert setpriv is not None, "setpriv is missing; apt-get install util-linux"
        command = [setpriv, f"--bounding-set={_POWERS}", f"--inh-caps={_POWERS}", *command]
    run = subprocess.run(
        command, capture_output=True, text=True, timeout=240, check=False, **options
    )
    assert run.returncode == 0, run.stderr
    keys = ("returncode", "stdout", "stderr")
    return [
        SimpleNamespace(**dict(zip(keys, json.loads(line), strict=True)))
        for line in run.stdout.splitlines()
    ]
