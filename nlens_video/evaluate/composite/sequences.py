"""`nlens-video evaluate sequences`: the lens found against the true one, frame by frame."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import astuple

from nlens_video.check.series import second_difference
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, Float32, Float64, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import ObjectSettings, OutputSettings, Settings, SourceSettings
from nlens_video.evaluate.composite.sequence import MARK, PARTS, Sequence, load_sequence
from nlens_video.evaluate.metrics import psnr, psnr_of_error
from nlens_video.evaluate.plates import find_folders, read_codes
from nlens_video.evaluate.report import Column, Report, Table, csv_lines, prepare_folder, track
from nlens_video.run.render import render

BLOCK_PX = 4
"""Side of the squares over which errors are averaged where noise is not to count [px]."""

_FINE_PX, _COARSE_PX = 1.0, 4.0  # sigmas between which the object's detail is measured
FOUND, TRUE, SHARP = "lens found", "true lens", "no blur"
_ABOUT = (
    "Each sequence is composited three times by the command line's defaults with `--effects "
    f"defocus` on its own layers: {FOUND}, on the plate; {TRUE}, given by `--fit`; {SHARP}, with "
    "`--effects none`. PSNR of 8-bit code values within the object's reach, as the truth gives it; "
    f"where the truth has noise of its own, that sets the level: the means of squares of "
    f"{BLOCK_PX} px, in which noise averages out, show what else is wrong. Spread: standard "
    "deviation over the frames. Flicker: root mean square of how far a frame's detail (logarithm "
    "of the band from sigma 1 to 4 px) lies off its neighbours' mean. The object's CoC: over the "
    "pixels that it covers wholly. PSNR and CoC are means over the sequences, the others the "
    "largest of them."
)


class FrameFigures(Struct, frozen=True, kw_only=True):
    """One frame of a composite against the truth; nan where the object is out of view.

    Attributes:
        psnr_db: of code values within the object's reach [dB].
        block_psnr_db: of the means of squares of `BLOCK_PX` that lie wholly within it [dB].
        detail: logarithm of the mean detail within it [1].
        coc_rms_px: error of the CoC that the lens gives the object, nan where no lens is used [px].
    """

    psnr_db: float = math.nan
    block_psnr_db: float = math.nan
    detail: float = math.nan
    coc_rms_px: float = math.nan


def evaluate_sequences(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> None:
    """Composite every sequence with the lens found, with the true one, and without blur.

    `folder` holds a folder for each sequence (see `sequence`), or is one itself; `out` gets
    `sequences.md`, `sequences.csv` and `sequence_frames.csv`.

    Raises:
        InputError: no sequence, or one that cannot be read.
        SceneError: a sequence's GLB cannot be used.
        LensFitError: a sequence does not tell its lens.
        OutputError: `out` cannot be written.
    """
    found = find_folders(folder, "sequence", MARK, PARTS)
    prepare_folder(out, plots=False)
    table, frames = _sequences_table(), list[list[object]]()
    for path in track(found, "compositing sequences", quiet=quiet):
        sequence = load_sequence(path)
        made = dict(_composites(sequence))
        if not any(math.isfinite(frame.detail) for frame in made[TRUE]):
            raise InputError(f"{path}: its truth is empty on every frame")
        for row, measured in made.items():
            table.add(row, path.name, over_sequence(measured, made[TRUE]))
            for index, frame in enumerate(measured):
                figures = (f if math.isfinite(f) else math.nan for f in astuple(frame))
                frames.append([row, path.name, index, *figures])
    columns = ["row", "sequence", "frame", *FrameFigures.__struct_fields__]
    names = ", ".join(table.plates())
    Report(
        name="sequences",
        sections=[f"# Sequences: the lens found against the true one\n\n{names}\n"],
        tables=[table],
        files={"sequence_frames.csv": csv_lines(columns, frames)},
    ).publish(out, as_json=as_json, quiet=quiet)


def _composites(sequence: Sequence) -> Iterator[tuple[str, list[FrameFigures]]]:
    """Figures of all frames by row; runs are like any other but for the lens they are given."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "plate").mkdir()
        plate = sequence.write_plate(work / "plate")
        lens = work / "true.json"
        lens.write_text(sequence.fit.to_json())
        for row, effects, fit in (
            (FOUND, "defocus", None), (TRUE, "defocus", lens), (SHARP, "none", None),
        ):  # fmt: skip
            pictures = work / row
            pictures.mkdir()
            settings = Settings(
                source=SourceSettings(spec=plate, input_rate=sequence.rate),
                scene=ObjectSettings(glb=sequence.folder / "object.glb", layers=sequence.layers),
                output=OutputSettings(spec=str(pictures / "%04d.png")),
                effects=effects,
                fit=fit,
            )
            yield row, list(_measured(sequence, pictures, render(settings).fit))


def _measured(sequence: Sequence, pictures: Path, fit: LensFit | None) -> Iterator[FrameFigures]:
    for index in range(sequence.frames):
        truth, reach = sequence.truth(index)
        picture = read_codes(pictures / f"{index:04d}.png", truth.shape[:2])
        rms = coc_rms(fit, sequence.fit, sequence.object_disparity(index))
        yield frame_figures(picture, truth, reach, rms)


def frame_figures(picture: UInt8, truth: UInt8, reach: Bool, coc_rms_px: float) -> FrameFigures:
    """Measure one frame.

    Args:
        picture: code values (H, W, 3).
        truth: code values (H, W, 3).
        reach: where the truth is given (H, W).
        coc_rms_px: error of the object's CoC [px].
    """
    if not reach.any():
        return FrameFigures()
    luma = picture.astype(np.float32).mean(axis=2)
    fine, coarse = (cv2.GaussianBlur(luma, (0, 0), sigma) for sigma in (_FINE_PX, _COARSE_PX))
    return FrameFigures(
        psnr_db=psnr(picture[reach], truth[reach]),
        block_psnr_db=_block_psnr(picture, truth, reach),
        detail=math.log(max(float(np.abs(fine - coarse)[reach].mean()), 1e-3)),
        coc_rms_px=coc_rms_px,
    )


def _block_psnr(picture: UInt8, truth: UInt8, reach: Bool) -> float:
    """PSNR of the means of squares that lie wholly within the reach; nan where there is none."""
    rows, columns = (length // BLOCK_PX for length in reach.shape)
    part = np.s_[: rows * BLOCK_PX, : columns * BLOCK_PX]
    squares = (rows, BLOCK_PX, columns, BLOCK_PX)
    inside = reach[part].reshape(squares).all(axis=(1, 3))
    if not inside.any():
        return math.nan
    error = picture[part].astype(np.float64) - truth[part]
    return psnr_of_error(error.reshape(*squares, 3).mean(axis=(1, 3))[inside])


def coc_rms(fit: LensFit | None, true: LensFit, disparity: Float32) -> float:
    """Error of the CoC of pixels of some disparities (n,), nan for no lens or no pixel [px]."""
    if fit is None or not disparity.size:
        return math.nan
    return float(np.sqrt(np.mean(np.square(fit.coc_px(disparity) - true.coc_px(disparity)))))


def over_sequence(frames: list[FrameFigures], reference: list[FrameFigures]) -> dict[str, float]:
    """The frames of a composite beside those of the one with the true lens.

    Args:
        frames: in order, at least one with the object in view.
        reference: of the same frames.
    """
    psnr_db, block_db, detail, coc_px = _series(frames)
    best_db, best_block_db, best_detail, _ = _series(reference)
    with np.errstate(invalid="ignore"):  # two frames that are equal to the truth
        gap, block_gap = best_db - psnr_db, best_block_db - block_db
    restless, calm = _flicker(detail), _flicker(best_detail)
    return {
        "psnr_db": _over(np.mean, psnr_db),
        "gap_db": _over(np.max, gap),
        "gap_spread_db": _over(np.std, gap),
        "spread_db": _over(np.std, psnr_db),
        "flicker_percent": 100.0 * restless,
        "more_flicker_percent": 100.0 * (restless / calm - 1.0) if calm else math.nan,
        "block_psnr_db": _over(np.mean, block_db),
        "block_gap_db": _over(np.max, block_gap),
        "object_rms_px": _over(np.mean, coc_px),
    }


def _series(frames: list[FrameFigures]) -> Float64:
    """Each figure of all frames (4, n)."""
    return np.array([astuple(frame) for frame in frames], np.float64).T


def _flicker(detail: Float64) -> float:
    """Root mean square of how far each frame's detail lies off its neighbours' mean [1]."""
    bent = second_difference(detail)[1:-1]
    return math.sqrt(_over(np.mean, bent**2))


def _over(one_of: Callable[[Float64], np.floating[Any]], values: Float64) -> float:
    """One of the values that are numbers; nan where none is."""
    known = values[np.isfinite(values)]
    return float(one_of(known)) if known.size else math.nan


def _sequences_table() -> Table:
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
        notes=(_ABOUT,),
    )
