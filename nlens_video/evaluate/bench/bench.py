"""`nlens-video bench`: accuracy of each reblur method against its time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path

from nlens_video.evaluate.bench.case import Case, built_case, plate_case
from nlens_video.evaluate.bench.measure import FULL, QUICK, Effort, machine, run_apart
from nlens_video.evaluate.bench.methods import all_rungs
from nlens_video.evaluate.bench.scenes import write_scenes
from nlens_video.evaluate.plates import find_plates, load_plate
from nlens_video.evaluate.plots import Point, accuracy_over_time
from nlens_video.evaluate.report import Column, Report, Table, prepare_folder, track

_NOTES = (
    "PSNR and SSIM of 8-bit code values in the tightest box around the sharp object. Times are "
    "those of the reblur alone, after warm-up: the mean of the medians on each scene, and the "
    "95th percentile on the slowest. Memory and start-up are those of a process that runs this "
    "rung and nothing else; start-up ends with its first frame. naive: no blur; one Gaussian: "
    "sigma a quarter of the object's mean CoC; layered Gaussian: of each pixel's own CoC, "
    "gathered, as Blind Augmentation (Prakash et al. 2025) does."
)


def bench(
    plates: Path | None, out: Path | None, *, quick: bool, as_json: bool, quiet: bool
) -> None:
    """Measure every rung on the built-in scenes and on plates.

    `plates` is a folder of plates rendered with and without their object, None for none; `quick`
    takes a truth of fewer views and fewer frames; `out` gets `bench.md`, a CSV for each table and
    `bench.png`.

    Raises:
        NlensError: a rung's process was ended.
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: a picture is asked for and matplotlib is missing.
    """
    found = find_plates(plates)[0] if plates else []
    rendered = [plate_case(load_plate(folder)) for folder in found]
    prepare_folder(out, plots=True)
    ran_on, rungs = machine(), all_rungs()
    effort = QUICK if quick else FULL
    with tempfile.TemporaryDirectory() as folder:
        scenes = write_scenes(Path(folder), effort.size)
        built = [
            built_case(scene, effort.size, effort.views)
            for scene in track(scenes, "making the truth", quiet=quiet)
        ]
        table = _scenes_table({scene.name: scene.about for scene in scenes}, effort)
        measured: list[tuple[Table, list[Case]]] = [(table, built)]
        if rendered:
            measured.append((_plates_table(), rendered))
        for rung in track(rungs, "running the rungs", quiet=quiet):
            cases = [case for _, held in measured for case in held if rung.can_run(case)]
            run = run_apart(rung, cases, effort)
            for table, held in measured:
                for case in filter(rung.can_run, held):
                    table.add(rung.name, case.name, run[case.name])
    tables = [table for table, _ in measured]
    ours = {rung.name for rung in rungs if rung.rival is None}
    panels = [(table.title, list(_points(table, ours))) for table in tables]
    about = "\n".join(f"- {name}: {value}" for name, value in ran_on.items())
    Report(
        name="bench",
        sections=[f"# What accuracy costs in time\n\n{about}\n"],
        tables=tables,
        facts={"machine": ran_on},
        plots={"bench.png": ("accuracy over time", partial(accuracy_over_time, panels))},
        csv_head="".join(f"# {name}: {value}\n" for name, value in ran_on.items()),
    ).publish(out, as_json=as_json, quiet=quiet)


def _points(table: Table, ours: set[str]) -> Iterable[Point]:
    for row in table.summary():
        name, ms, psnr_db = str(row["name"]), row["median_ms"], row["psnr_db"]
        if isinstance(ms, float) and isinstance(psnr_db, float):  # an exact result has no dB
            yield Point(name, ms, psnr_db, name in ours)


def _scenes_table(abouts: Mapping[str, str], effort: Effort) -> Table:
    listed = "; ".join(f"{name}: {about}" for name, about in abouts.items())
    columns, rows = effort.size
    return _table(
        "bench",
        f"Against the lens, {effort.views} views of it",
        f"Scenes of {columns}x{rows} pixels: {listed}. The true CoC is given.",
    )


def _plates_table() -> Table:
    about = "The object's layers and its true CoC are given."
    return _table("bench_plates", "Against plates rendered with their object", about)


def _table(name: str, title: str, about: str) -> Table:
    return Table(
        name=name,
        title=title,
        columns=(
            Column("psnr_db", "PSNR [dB]"),
            Column("ssim", "SSIM", 4),
            Column("median_ms", "median [ms]", 1),
            Column("p95_ms", "p95, worst [ms]", 1, over="worst"),
            Column("peak_mib", "peak memory [MiB]", 0, over="worst"),
            Column("startup_s", "start-up [s]", 1),
        ),
        detail="psnr_db",
        notes=(about, _NOTES),
    )
