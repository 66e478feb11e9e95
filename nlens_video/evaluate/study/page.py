"""`nlens-video study make`: pictures and their list, and the page that asks about them.

A folder holds the pictures and `stimuli.csv`, a line for each: its `file`, the `position` of the
virtual object, `aperture` and `focus` of the lens, the `method` that put it in, and `virtual`, the
answer that names it.
"""

from __future__ import annotations

import base64
import csv
import json
import tempfile
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from msgspec import Struct
from msgspec.structs import asdict

from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.stdio import escape_controls, print_out, standard_error
from nlens_video.video.atomic_files import check_folder, replacing

LIST = "stimuli.csv"
QUESTION = "Do you believe there are virtual {things} in the image?"
_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".webp": "image/webp"}


class Stimulus(Struct, frozen=True, kw_only=True):
    """A picture of the study: the columns of the list."""

    file: str
    position: str
    aperture: str
    focus: str
    method: str
    virtual: str


COLUMNS = Stimulus.__struct_fields__


def load_stimuli(folder: Path) -> list[Stimulus]:
    """Read the list of a folder and check that its pictures are there.

    Raises:
        InputError: no list, one that cannot be used, a picture that is missing or of no known kind.
    """
    path = folder / LIST
    try:
        with path.open(newline="", encoding="utf-8") as lines:
            reader = csv.DictReader(lines)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            rows = [] if missing else list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); expected a line for each picture: "
            f"{','.join(COLUMNS)}"
        ) from error
    if missing or not rows:
        lacking = f"the columns {', '.join(missing)}" if missing else "any picture"
        raise InputError(f"{path}: lacks {lacking}; expected a line for each: {','.join(COLUMNS)}")
    stimuli = [_stimulus(path, number, row) for number, row in enumerate(rows, 2)]
    _check_pictures(folder, stimuli)
    return stimuli


def write_stimuli(folder: Path, stimuli: list[Stimulus]) -> None:
    """Write the list of a folder."""
    with (folder / LIST).open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(map(asdict, stimuli))


def _stimulus(path: Path, number: int, row: dict[str, str | None]) -> Stimulus:
    cells = {name: (row[name] or "").strip() for name in COLUMNS}
    empty = [name for name, cell in cells.items() if not cell]
    if empty:
        raise InputError(f"{path}: line {number} has no {', '.join(empty)}; each picture needs it")
    return Stimulus(**cells)


def _check_pictures(folder: Path, stimuli: list[Stimulus]) -> None:
    seen: set[str] = set()
    for one in stimuli:
        if Path(one.file).suffix.lower() not in _TYPES:
            raise InputError(f"{folder / one.file}: expected one of {', '.join(_TYPES)}")
        if not (folder / one.file).is_file():
            raise InputError(f"{folder / one.file}: no such file; {LIST} names it")
        if one.file in seen:
            raise InputError(f"{folder / LIST}: {one.file} stands in it twice; once is right")
        seen.add(one.file)


def study_page(
    folder: Path, stimuli: Sequence[Stimulus], choices: Sequence[str], things: str
) -> str:
    """The page as text, everything from outside escaped; arguments as of `make_study`.

    Raises:
        InputError: a picture cannot be read.
    """
    home = files("nlens_video.evaluate.study")
    template = Template(home.joinpath("page.html").read_text(encoding="utf-8"))
    trials = [asdict(one) | {"src": _picture_address(folder / one.file)} for one in stimuli]
    boxes = "".join(
        f'<label><input type="checkbox" name="choice" value="{escape(choice)}"> '
        f"<kbd>{number}</kbd> {escape(choice)}</label>"
        for number, choice in enumerate(choices, 1)
    )
    return template.substitute(
        style=home.joinpath("page.css").read_text(encoding="utf-8"),
        script=home.joinpath("page.js").read_text(encoding="utf-8"),
        question=escape(QUESTION.format(things=things)),
        things=escape(things),
        count=len(trials),
        choices=boxes,
        trials=json.dumps(trials).replace("<", "\\u003c"),
    )


def _picture_address(path: Path) -> str:
    """The picture as an address that holds all of it (`data:`)."""
    try:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    return f"data:{_TYPES[path.suffix.lower()]};base64,{data}"


def make_study(
    folder: Path, out: Path, choices: str | None, things: str, *, as_json: bool, quiet: bool
) -> None:
    """Write the study's page and say so.

    Args:
        folder: pictures and their list.
        out: the page.
        choices: answers beside "No", separated by commas; None for all that are right once.
        things: what is looked for, in the plural.
        as_json: say it as JSON on standard output.
        quiet: say nothing but JSON.

    Raises:
        InputError: the pictures or their list cannot be used.
        UsageError: choices among which a right answer is missing.
        OutputError: the page cannot be written.
    """
    stimuli = load_stimuli(folder)
    right = list(dict.fromkeys(one.virtual for one in stimuli))
    offered = right if choices is None else [name.strip() for name in choices.split(",")]
    lacking = [name for name in right if name not in offered]
    if lacking or not all(offered) or len(set(offered)) < len(offered):
        raise UsageError(
            f"--choices {choices}: expected names, each once, with {', '.join(right)} among them"
        )
    if any(";" in name for name in offered):
        raise UsageError("an answer with ; in it cannot be told from two; name it otherwise")
    page = study_page(folder, stimuli, offered, things)
    with replacing(out) as partial:
        partial.write_text(page, encoding="utf-8")
    if as_json:
        print_out(json.dumps({"saved": str(out), "pictures": len(stimuli)}, indent=2) + "\n")
    elif not quiet:
        told = escape_controls(f"{'wrote':7}{out}, {len(stimuli)} pictures")
        standard_error().write(f"{told}\n")


def make_demo(out: Path, *, as_json: bool, quiet: bool) -> None:
    """Make pictures of rendered balls on a table, and the page that asks about them.

    Args:
        out: the page.
        as_json: as of `make_study`.
        quiet: as of `make_study`; then no progress is shown either.

    Raises:
        NlensError: the renderer cannot run.
        OutputError: the page cannot be written.
    """
    from nlens_video.evaluate.study.demo import CHOICES, write_demo

    check_folder(out)
    with tempfile.TemporaryDirectory() as folder:
        write_demo(Path(folder), quiet=quiet)
        make_study(Path(folder), out, CHOICES, "billiard balls", as_json=as_json, quiet=quiet)
