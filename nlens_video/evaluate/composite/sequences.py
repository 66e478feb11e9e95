"""`nlens-video evaluate sequences`: the lens found against the true one, frame by frame."""

from __future__ import annotations

import csv
import io
import json
import math
import tempfile
from dataclasses import asdict
from functools import partial
from pathlib import Path

from nlens_video.core.errors import InputError
from nlens_video.core.settings import ObjectSettings, OutputSettings, Settings, SourceSettings
from nlens_video.evaluate.bench.case import codes_of
from nlens_video.evaluate.composite.sequence import Sequence, find_sequences, load_sequence
from nlens_video.evaluate.composite.sequence_figures import (  # fmt: skip
    BLOCK_PX,
    FrameFigures,
    coc_rms,
    frame_figures,
    over_sequence,
)
from nlens_video.evaluate.console import Progress, make_folder, tell_and_write, write_texts
from nlens_video.evaluate.tables import Column, Entry, Table
from nlens_video.run.render import render

FOUND, TRUE, SHARP = "lens found", "true lens", "no blur"
_HEADING = "# Sequences: the lens found against the true one\n\n"
ABOUT = (
    "Each sequence is composited three times by the command line's defaults with `--effects "
    f"defocus` on its own layers: {FOUND}, on the plate; {TRUE}, told by `--fit`; {SHARP}, with "
    "`--effects none`. PSNR of 8-bit code values within the object's reach, as the truth gives it; "
    f"where the truth has noise of its own, that sets the level: the means of squares of "
    f"{BLOCK_PX} px, in which noise averages out, show what else is wrong. Spread: standard "
    "deviation over the frames. Flicker: root mean square of how far a frame's detail (logarithm "
    "of the band from sigma 1 to 4 px) lies off its neighbours' mean. The object's CoC: over the "
    "pixels that it covers wholly. PSNR and CoC are means over the sequences, the others the "
    "largest of them."
)


def evaluate_sequences(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> int:
    """Composite every sequence with the lens found and with the true one, print and write tables.

    Args:
        folder: one with a folder for each sequence (see `sequence`), or a sequence itself.
        out: gets `sequences.md`, `sequences.csv` and `sequence_frames.csv`; made where missing.
        as_json: print all figures as JSON instead of a table.
        quiet: print nothing but JSON.

    Returns:
        The exit code, 0.

    Raises:
        InputError: no sequence, or one that cannot be read.
        SceneError: a sequence's GLB cannot be used.
        LensFitError: a sequence does not tell its lens.
        OutputError: `out` cannot be written.
    """
    found = find_sequences(folder)
    if out is not None:
        make_folder(out)
    table, frames = sequences_table(), Frames()
    for path in Progress(quiet=quiet).track(found, "compositing sequences"):
        _measure(load_sequence(path), table, frames)
    text = f"{_HEADING}{', '.join(table.plates())}\n\n{table.markdown()}"
    texts = {
        "sequences.md": text,
        "sequences.csv": table.csv(),
        "sequence_frames.csv": frames.csv(),
    }
    printed = json.dumps({table.name: table.json()}, indent=2) + "\n" if as_json else text
    writing = None if out is None else partial(write_texts, out, texts)
    tell_and_write(printed, writing, quiet=quiet and not as_json)
    return 0


class Frames:
    """The figures of every frame, for plots."""

    def __init__(self) -> None:
        self._rows: list[dict[str, object]] = []

    def add(self, row: str, sequence: str, frames: list[FrameFigures]) -> None:
        """Take the frames of a composite, in order."""
        for index, frame in enumerate(frames):
            named = {"row": row, "sequence": sequence, "frame": index}
            self._rows.append({**named, **{k: _cell(v) for k, v in asdict(frame).items()}})

    def csv(self) -> str:
        """A line for each; empty where not defined."""
        text = io.StringIO()
        writer = csv.DictWriter(text, list(self._rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._rows)
        return text.getvalue()


def _cell(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else ""


def _measure(sequence: Sequence, table: Table, frames: Frames) -> None:
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        plate = _made(work / "plate")
        spec = sequence.write_plate(plate)
        lens = work / "true.json"
        lens.write_text(sequence.fit.to_json())
        made = {
            FOUND: _composited(sequence, spec, _made(work / "found"), "defocus", None),
            TRUE: _composited(sequence, spec, _made(work / "true"), "defocus", lens),
            SHARP: _composited(sequence, spec, _made(work / "sharp"), "none", None),
        }
    if not any(math.isfinite(frame.detail) for frame in made[TRUE]):
        raise InputError(f"{sequence.folder}: its truth is empty on every frame")
    for row, measured in made.items():
        table.entries.append(Entry(row, sequence.name, over_sequence(measured, made[TRUE])))
        frames.add(row, sequence.name, measured)


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _composited(
    sequence: Sequence, plate: str, folder: Path, effects: str, lens: Path | None
) -> list[FrameFigures]:
    """The figures of all frames of a run that is like any other but for the lens it is told."""
    settings = Settings(
        source=SourceSettings(spec=plate, input_rate=sequence.rate),
        scene=ObjectSettings(glb=sequence.glb, layers=sequence.layers),
        output=OutputSettings(spec=str(folder / "%04d.png")),
        effects=effects,
        fit=lens,
    )
    fit = render(settings).fit
    size = (sequence.fit.height, sequence.fit.width)
    measured = []
    for index in range(sequence.frames):
        picture = codes_of(folder / f"{index:04d}.png", size)
        truth, reach = sequence.truth(index)
        rms = coc_rms(fit, sequence.fit, sequence.object_disparity(index))
        measured.append(frame_figures(picture, truth, reach, rms))
    return measured


def sequences_table() -> Table:
    """An empty table of sequences."""
    return Table(
        name="sequences",
        title="Composites of sequences, with the lens found and with the true one",
        columns=(
            Column("psnr_db", "PSNR [dB]"),
            Column("gap_db", "worst frame below the true lens [dB]", 2, "most"),
            Column("gap_spread_db", "spread of that [dB]", 2, "most"),
            Column("spread_db", "spread of the PSNR [dB]", 2, "most"),
            Column("more_flicker_percent", "flicker above the true lens' [%]", 1, "most"),
            Column("block_psnr_db", f"PSNR of {BLOCK_PX} px means [dB]"),
            Column("block_gap_db", "worst frame of those below [dB]", 2, "most"),
            Column("object_rms_px", "object's CoC, rms [px]"),
        ),
        detail="gap_db",
        notes=(ABOUT,),
    )
