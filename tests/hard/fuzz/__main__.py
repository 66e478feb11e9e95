"""The long run: damaged files of every kind, killed runs; the figures go to a page.

    PYTHONPATH=tests python -m hard.fuzz [--inputs N] [--kills N] [--workers N] [--page FILE.md]

Inputs that go wrong are kept, each beside what was said, in `--keep`. Exit code 1 where any did.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from hard.faults.kills import Executioner, Tally, make_shot
from hard.fuzz.campaign import all_tried, keep
from hard.fuzz.kinds import KINDS
from hard.fuzz.page import fuzz_part, kills_part, write_page


def kill(count: int) -> tuple[Tally, Tally]:
    """Half of the kills with `--keep-partial`, half with `--resume`."""
    with tempfile.TemporaryDirectory(prefix="nlens-kills-") as name:
        keeping = Executioner(make_shot(Path(name) / "keeping", 300), seed=1)
        while keeping.tally.kills < count // 2:
            keeping.kill_keeping()
            print(f"--keep-partial: {keeping.tally}")
        keeping.finish()
        resuming = Executioner(make_shot(Path(name) / "resuming", 300), seed=2)
        while resuming.tally.kills < count - count // 2:
            resuming.kill_resumable()
            print(f"--resume: {resuming.tally}")
        resuming.finish("--resume")
    return keeping.tally, resuming.tally


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="hard.fuzz", description=__doc__.split("\n")[0])
    parser.add_argument("--inputs", type=int, default=125_674, help="damaged files in all")
    parser.add_argument("--kills", type=int, default=100, help="runs to kill")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--page", type=Path, default=Path("docs/faults.md"))
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    parser.add_argument("--kind", action="append", choices=sorted(KINDS), help="only these")
    asked = parser.parse_args(words)
    failed = False
    if asked.inputs:
        counts = all_tried(asked.inputs, asked.kind or list(KINDS), asked.workers)
        for name, count in counts.items():
            keep(name, count, asked.keep)
            failed |= bool(count.faults)
        write_page(asked.page, {"fuzz": fuzz_part(counts)})
    if asked.kills:
        tallies = kill(asked.kills)
        failed |= any(tally.lost or tally.broken or tally.strange for tally in tallies)
        write_page(asked.page, {"kills": kills_part(tallies)})
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
