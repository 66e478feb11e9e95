"""One process that reads damaged files, one after the other; its parent reads what became of them.

    python -m hard.fuzz.worker KIND FIRST END FOLDER

A line of JSON for each input that went wrong. `FOLDER/at` holds the number of the input at work
and the counts before it, so that the parent knows which one has killed the process.
"""

from __future__ import annotations

import collections
import faulthandler
import json
import os
import random
import resource
import sys
import traceback
import warnings
from pathlib import Path

MEMORY_BYTES = 4 << 30
"""Of address space, libraries and threads' stacks included."""
INPUT_S = 20.0
"""After so long an input counts as a hang."""


def damaged_input(kind: str, files: list[bytes], number: int) -> bytes:
    """The input of a number; it is the same on every machine."""
    from hard.fuzz.kinds import KINDS

    rng = random.Random(f"{kind} {number}")
    return KINDS[kind].mutate(rng.choice(files), rng, rng.choice(files))


def judged(kind: str, path: Path) -> str:
    """`read`, `refused`, or what went wrong."""
    from hard.fuzz.kinds import KINDS

    from nlens_video.core.errors import NlensError

    try:
        KINDS[kind].use(path)
    except NlensError as error:
        return "refused" if "\n" not in str(error) else f"more than a line: {str(error)!r}"
    except Exception:  # noqa: BLE001  # whatever else escapes is what this looks for
        return traceback.format_exc()
    return "read"


def main(kind: str, first: int, end: int, folder: Path) -> None:
    from hard.fuzz.kinds import KINDS

    reports = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # where native code talks too
    faulthandler.enable()
    warnings.simplefilter("error")
    made = folder / "made"
    made.mkdir(exist_ok=True)
    files = [path.read_bytes() for path in KINDS[kind].make(made)]
    path = made / f"input{KINDS[kind].suffix}"
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    counts: collections.Counter[str] = collections.Counter()
    for number in range(first, end):
        path.write_bytes(damaged_input(kind, files, number))
        (folder / "at").write_text(json.dumps({"number": number, **counts}))
        faulthandler.dump_traceback_later(INPUT_S, exit=True)
        answer = judged(kind, path)
        faulthandler.cancel_dump_traceback_later()
        counts[answer if answer in ("read", "refused") else "wrong"] += 1
        if answer not in ("read", "refused"):
            print(json.dumps({"number": number, "wrong": answer}), file=reports, flush=True)
    (folder / "at").write_text(json.dumps({"number": end, **counts}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
