"""Workers sent over a kind of file until all its inputs were tried, whatever kills them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from hard.fuzz.kinds import KINDS
from hard.fuzz.worker import damaged_input
from support.folders import TESTS

_BATCH = 4000
_PATIENCE_S = 3600.0


@dataclass
class Count:
    """What became of a kind's inputs.

    Attributes:
        tried: inputs in all.
        read: those that were read in spite of their damage.
        refused: those that one line refused.
        wrong: other errors, by the input's number.
        crashes: deaths of the process.
        hangs: inputs that took longer than the worker allows.
        seconds: of processes, summed.
    """

    tried: int = 0
    read: int = 0
    refused: int = 0
    wrong: dict[int, str] = field(default_factory=dict)
    crashes: dict[int, str] = field(default_factory=dict)
    hangs: dict[int, str] = field(default_factory=dict)

    @property
    def faults(self) -> dict[int, str]:
        return {**self.wrong, **self.crashes, **self.hangs}


def tried(kind: str, first: int, end: int) -> Count:
    """Send workers over the inputs from `first` to `end` - 1."""
    count = Count()
    while first < end:
        with tempfile.TemporaryDirectory(prefix="nlens-fuzz-") as name:
            first = _batch(kind, first, min(end, first + _BATCH), Path(name), count)
    return count


def _batch(kind: str, first: int, end: int, folder: Path, count: Count) -> int:
    """The number to go on with."""
    command = [sys.executable, "-W", "error", "-m", "hard.fuzz.worker",
               kind, str(first), str(end), str(folder)]  # fmt: skip
    paths = [str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")]
    run = subprocess.run(
        command, capture_output=True, text=True, timeout=_PATIENCE_S,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)),
             "OMP_NUM_THREADS": "1", "PYTHONIOENCODING": "utf-8:backslashreplace"},
    )  # fmt: skip
    for line in run.stdout.splitlines():
        said = json.loads(line)
        count.wrong[said["number"]] = said["wrong"]
    at = json.loads((folder / "at").read_text()) if (folder / "at").is_file() else None
    if at is None:
        raise RuntimeError(f"{kind}: the worker does not start\n{run.stderr}")
    reached = at.pop("number")
    count.read += at.get("read", 0)
    count.refused += at.get("refused", 0)
    count.tried += reached - first
    if run.returncode == 0:
        return reached
    fate = count.hangs if "Timeout (" in run.stderr else count.crashes
    fate[reached] = run.stderr[-4000:]
    count.tried += 1
    return reached + 1


def all_tried(total: int, names: list[str], workers: int, say=print) -> dict[str, Count]:
    """Share inputs out over kinds, and kinds over workers."""
    shares = sum(KINDS[name].share for name in names)
    with ThreadPoolExecutor(workers) as pool:
        waiting = {
            name: pool.submit(tried, name, 0, round(total * KINDS[name].share / shares))
            for name in names
        }
        counts = {}
        for name, future in waiting.items():
            counts[name] = future.result()
            say(f"{name}: {summary(counts[name])}")
    return counts


def summary(count: Count) -> str:
    return (
        f"{count.tried} inputs, {count.read} read, {count.refused} refused, {len(count.wrong)} "
        f"wrong, {len(count.crashes)} crashes, {len(count.hangs)} hangs"
    )


def keep(kind: str, count: Count, folder: Path) -> None:
    """Write the inputs that went wrong, each with what was said, to be looked into."""
    with tempfile.TemporaryDirectory(prefix="nlens-fuzz-") as name:
        files = [path.read_bytes() for path in KINDS[kind].make(Path(name))]
    for number, said in count.faults.items():
        stem = "".join(letter if letter.isalnum() else "_" for letter in kind)
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{stem}-{number}{KINDS[kind].suffix}"
        path.write_bytes(damaged_input(kind, files, number))
        path.with_name(f"{path.name}.txt").write_text(said)
