"""The pictures of a study and what each of them shows.

A folder holds the pictures and `stimuli.csv`, a line for each: its `file`, the `position` of the
virtual object, `aperture` and `focus` of the lens, the `method` that put it in, and `virtual`, the
answer that names it.
"""

from __future__ import annotations

import base64
import csv
from dataclasses import dataclass, fields
from pathlib import Path

from nlens_video.core.errors import InputError

LIST = "stimuli.csv"
_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".webp": "image/webp"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stimulus:
    """A picture of the study.

    Attributes:
        file: its name in the folder.
        position: where the virtual object stands.
        aperture: of the lens that took the plate.
        focus: of that lens.
        method: what put the object in.
        virtual: the answer that names the virtual object.
    """

    file: str
    position: str
    aperture: str
    focus: str
    method: str
    virtual: str


COLUMNS = tuple(field.name for field in fields(Stimulus))


def load_stimuli(folder: Path) -> list[Stimulus]:
    """Read the list of a folder and see that its pictures are there.

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


def picture_address(folder: Path, stimulus: Stimulus) -> str:
    """The picture as an address that holds all of it (`data:`).

    Raises:
        InputError: it cannot be read.
    """
    path = folder / stimulus.file
    try:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    return f"data:{_TYPES[path.suffix.lower()]};base64,{data}"


def write_stimuli(folder: Path, stimuli: list[Stimulus]) -> None:
    """Write the list of a folder."""
    with (folder / LIST).open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([getattr(one, name) for name in COLUMNS] for one in stimuli)


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
