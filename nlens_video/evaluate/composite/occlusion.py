"""`nlens-video evaluate occlusion`: what walks before an object, against the true composite.

A clip is a folder as of `sequence`, which also holds `front/NNNN.png` (coverage by what is nearer
than the object) and, in `params.json`, for each of the `frames` its `walkers`: `meets_px`, the
pixels of the object that each shares, and whether it is `before` it. A frame without truth is in
no PSNR, one without the object in no figure of the matte.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box, Float32, UInt8
from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    RealSettings,
    Settings,
    SourceSettings,
)
from nlens_video.evaluate.composite.sequence import MARK, PARTS, Sequence, load_sequence
from nlens_video.evaluate.metrics import psnr
from nlens_video.evaluate.plates import find_folders
from nlens_video.evaluate.report import Column, Report, Table, csv_lines, prepare_folder, track
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.executor import FrameState
from nlens_video.run.open_run import open_run
from nlens_video.video.exr import read_layer

FOUND, TRUE, NOTHING = "found", "true matte", "nothing in front"
_MEETS = 0.02  # of the object, from which on a walker is before or behind it on a frame [1]
_EFFECTS = "auto,-shadow,-grain,-softness"
_ABOUT = (
    "Each clip is composited with its own layers through the true lens: "
    f"{FOUND}, by the defaults; {TRUE}, given by `--holdout`; {NOTHING}, by `--occlusion none`. "
    "PSNR of 8-bit code values in the object's box: on frames where something nearer covers "
    f"{_MEETS:.0%} of the object or more, and on the others. The matte is read from composites of "
    "a white and of a black object; its error is over the object's pixels, on frames where "
    "something meets the object. The order is right where what the matte covers is nearer to the "
    "truth than to the reverse. Flicker: root mean square over pixels and frames of the second "
    "difference in time of the matte's error, where the object is."
)


class FrameOrder(Struct, frozen=True, kw_only=True):
    """What meets the object on a frame.

    Attributes:
        meets_px: pixels of the object that things share with it [px].
        before_px: those of things that are nearer [px].
    """

    meets_px: float
    before_px: float


def evaluate_occlusion(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> None:
    """Composite every clip with the foreground found, given and left out.

    A clip that shows the object on no frame is named, and is in no figure.

    Raises:
        InputError: no clip, one that cannot be read, or none that shows the object.
        SceneError: a clip's GLB cannot be used.
        OutputError: `out` cannot be written.
    """
    found = find_folders(folder, "clip", MARK, (*PARTS, "front"))
    prepare_folder(out, plots=False)
    table, frames, unseen = _table(), list[list[object]](), list[str]()
    for path in track(found, "compositing clips", quiet=quiet):
        sequence, orders = load_sequence(path), load_orders(path)
        if not _shows_object(sequence):
            unseen.append(path.name)
            continue
        for row, composites in _composites(sequence):
            figures, rows = measure(sequence, orders, composites)
            table.add(row, path.name, figures)
            frames += [[row, path.name, *one] for one in rows]
    if not table.entries:
        raise InputError(
            f"{folder}: the object is out of view on all frames ({', '.join(unseen)}); "
            "give clips that show it"
        )
    left_out = f"\nLeft out, since no frame shows the object: {', '.join(unseen)}.\n"
    columns = ["row", "clip", "frame", "psnr_db", "before", "matte_percent"]
    Report(
        name="occlusion",
        sections=[
            f"# Moving foreground\n\n{', '.join(table.plates())}\n{left_out if unseen else ''}"
        ],
        tables=[table],
        facts={"left_out": unseen},
        files={"occlusion_frames.csv": csv_lines(columns, frames)},
    ).publish(out, as_json=as_json, quiet=quiet)


def _shows_object(sequence: Sequence) -> bool:
    size = sequence.fit.width, sequence.fit.height
    layers = (Path(sequence.layers % index) for index in range(sequence.frames))
    return any(bool(read_layer(layer, size).rgba[..., 3].any()) for layer in layers)


def load_orders(folder: Path) -> tuple[FrameOrder, ...]:
    """What meets the object on each frame of a clip.

    Raises:
        InputError: the description cannot be read.
    """
    path = folder / "params.json"
    try:
        described: dict[str, Any] = json.loads(path.read_text())
        return tuple(
            FrameOrder(
                meets_px=math.fsum(float(one["meets_px"]) for one in frame["walkers"]),
                before_px=math.fsum(
                    float(one["meets_px"]) for one in frame["walkers"] if one["before"]
                ),
            )
            for frame in described["frames"]
        )
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: cannot be read as a clip's description ({error})") from error


class FrameResult(Struct, frozen=True, kw_only=True):
    """A frame that was composited.

    Attributes:
        codes: 8-bit code values (H, W, 3).
        matte: coverage by what is in front of the object (H, W) [1].
    """

    codes: UInt8
    matte: Float32


def _composites(sequence: Sequence) -> Iterator[tuple[str, Iterator[FrameResult]]]:
    """The frames of each row."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "plate").mkdir()
        plate = sequence.write_plate(work / "plate")
        (work / "true.json").write_text(sequence.fit.to_json())
        holdout = str(sequence.folder / "front" / "%04d.png")
        ways: tuple[tuple[str, RealSettings], ...] = (
            (FOUND, RealSettings()),
            (TRUE, RealSettings(holdout=holdout)),
            (NOTHING, RealSettings(occlusion="none")),
        )
        for row, real in ways:
            settings = Settings(
                source=SourceSettings(spec=plate, input_rate=sequence.rate),
                scene=ObjectSettings(
                    glb=sequence.folder / "object.glb", layers=sequence.layers, real=real
                ),
                output=OutputSettings(spec=str(work / "%04d.png")),
                effects=_EFFECTS,
                fit=work / "true.json",
            )
            yield row, composited(settings)


def composited(settings: Settings) -> Iterator[FrameResult]:
    """The frames of a run, which is written nowhere."""
    with open_run(settings, Profiler()) as run_input:
        session = run_input.session
        with session.render_context():
            for state in run_input.items([]):
                if not isinstance(state, FrameState):
                    continue
                session.executor.run(state, session.graph.nodes)
                session.executor.profiler.close_frame(state.frame.index, state.frame.pts)
                codes = np.rint(255.0 * state.picture.srgb())
                yield FrameResult(codes=codes.astype(np.uint8), matte=_matte(state))


def _matte(state: FrameState) -> Float32:
    out = np.zeros((state.picture.height, state.picture.width), np.float32)
    foreground = state.values.foreground
    if foreground is not None and foreground.before_object is not None:
        cover = foreground.before_object
        out[cover.box.slices_in(state.values.frame_box)] = cover.coverage
    return out


def measure(
    sequence: Sequence, orders: tuple[FrameOrder, ...], frames: Iterator[FrameResult]
) -> tuple[dict[str, float], list[list[object]]]:
    """Figures of a row on a clip, and of each frame: number, PSNR, before, error of the matte.

    Raises:
        InputError: a file of a frame cannot be read, or has another size than the clip.
    """
    size = sequence.fit.height, sequence.fit.width
    before_db: list[float] = []
    other_db: list[float] = []
    off_percent: list[float] = []
    right: list[bool] = []
    bends: list[float] = []
    errors: list[Float32] = []
    rows: list[list[object]] = []
    for index, (order, frame) in enumerate(zip(orders, frames, strict=True)):
        truth, reach = sequence.truth(index)
        alpha = read_layer(Path(sequence.layers % index), size[::-1]).rgba[..., 3]
        pixels = float(alpha.sum())
        front = _front(sequence.folder / "front" / f"{index:04d}.png", size)
        part = Box.of(reach).slices_in(Box(0, 0, *size[::-1]))
        decibels = psnr(frame.codes[part], truth[part]) if reach.any() else math.nan
        covered = order.before_px > _MEETS * pixels
        (before_db if covered else other_db).append(decibels)
        off = math.nan
        if pixels:
            errors = [*errors[-2:], (frame.matte - front) * alpha]
            off = 100.0 * float(np.abs(errors[-1]).sum()) / pixels
        else:
            errors = []  # no difference in time spans a frame without the object
        if order.meets_px > _MEETS * pixels > 0.0:
            off_percent.append(off)
            seen = float((frame.matte * alpha).sum())
            right.append(abs(seen - order.before_px) < 0.5 * order.meets_px)
        if len(errors) == 3:
            bend = errors[0] - 2.0 * errors[1] + errors[2]
            bends.append(float(np.square(bend).sum()) / pixels)
        rows.append([index, decibels, int(covered), off])
    return {
        "before_db": _mean(before_db),
        "other_db": _mean(other_db),
        "matte_percent": _mean(off_percent),
        "order_percent": 100.0 * _mean(right),
        "flicker_percent": 100.0 * math.sqrt(_mean(bends)),
    }, rows


def _mean(values: list[float] | list[bool]) -> float:
    """Mean of the values that are finite numbers; nan where none is."""
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else math.nan


def _front(path: Path, size: tuple[int, int]) -> Float32:
    """Coverage in [0, 1] (H, W) of a grey picture of so many rows and columns."""
    if not path.is_file():  # OpenCV warns by itself
        raise InputError(f"{path}: no such file")
    codes: UInt8 | None = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)  # type: ignore[assignment]
    if codes is None or codes.shape != size:
        raise InputError(f"{path}: cannot be read as a grey picture of {size[1]}x{size[0]}")
    return codes.astype(np.float32) / np.float32(255.0)


def _table() -> Table:
    return Table(
        name="occlusion",
        title="Composites of clips in which something walks before, behind and past the object",
        columns=(
            Column("before_db", "PSNR where something is in front [dB]"),
            Column("other_db", "PSNR elsewhere [dB]"),
            Column("matte_percent", "error of the matte [% of the object]"),
            Column("matte_percent", "worst clip [%]", 2, "most"),
            Column("order_percent", "frames in the right order [%]", 1),
            Column("flicker_percent", "flicker of the matte [%]"),
            Column("flicker_percent", "worst clip [%]", 2, "most"),
        ),
        detail="before_db",
        notes=(_ABOUT,),
    )
