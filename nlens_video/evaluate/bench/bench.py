"""`nlens-video bench`: accuracy of each reblur method against its time."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from nlens_video.evaluate.bench.case import Case, built_case, plate_case
from nlens_video.evaluate.bench.measure import (
    FULL,
    QUICK,
    Effort,
    RungRun,
    run_apart,
)
from nlens_video.evaluate.bench.methods import Rung, all_rungs
from nlens_video.evaluate.bench.report import (
    Report,
    machine,
    plates_table,
    scenes_table,
)
from nlens_video.evaluate.bench.scenes import BuiltScene, write_scenes
from nlens_video.evaluate.console import Progress, check_matplotlib, make_folder, tell_and_write
from nlens_video.evaluate.plates import find_plates
from nlens_video.evaluate.tables import Entry, Table


def bench(plates: Path | None, out: Path | None, *, quick: bool, as_json: bool, quiet: bool) -> int:
    """Measure every rung on the built-in scenes and on plates, print the tables, write files.

    Args:
        plates: folder of plates rendered with and without their object; None for none.
        out: gets `bench.md`, a CSV for each table and `bench.png`; made where it is missing.
        quick: a truth of fewer views, fewer frames.
        as_json: print all figures as JSON instead of tables.
        quiet: print nothing but JSON.

    Returns:
        The exit code, 0.

    Raises:
        NlensError: a rung's process was ended.
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: a picture is asked for and matplotlib is missing.
    """
    if out is not None:
        check_matplotlib()
    rendered = [plate_case(folder) for folder in find_plates(plates)[0]] if plates else []
    if out is not None:
        make_folder(out)
    show = Progress(quiet=quiet)
    effort = QUICK if quick else FULL
    with tempfile.TemporaryDirectory() as folder:
        scenes = write_scenes(Path(folder), effort.size)
        report = measure(scenes, rendered, all_rungs(), effort, show)
    text = report.json() if as_json else report.markdown()
    write = None if out is None else partial(report.write, out)
    tell_and_write(text, write, quiet=quiet and not as_json)
    return 0


def measure(
    scenes: Sequence[BuiltScene],
    plates: Sequence[Case],
    rungs: Sequence[Rung],
    effort: Effort,
    show: Progress,
) -> Report:
    """Make the scenes' truth, run the rungs one after another, collect their figures.

    Args:
        scenes: of `write_scenes`, for frames of `effort.size`.
        plates: further cases.
        rungs: what runs.
        effort: how much.
        show: tells how far it is.
    """
    ran_on = machine()
    built = [
        built_case(scene, effort.size, effort.views)
        for scene in show.track(scenes, "making the truth")
    ]
    tables = [(scenes_table({s.name: s.about for s in scenes}, effort), built)]
    if plates:
        tables.append((plates_table(), list(plates)))
    for rung in show.track(rungs, "running the rungs"):
        cases = [case for _, held in tables for case in held if rung.can_run(case)]
        run = run_apart(rung, cases, effort)
        for table, held in tables:
            _collect(table, rung, run, [case for case in held if rung.can_run(case)])
    return Report(machine=ran_on, tables=[table for table, _ in tables], rungs=rungs)


def _collect(table: Table, rung: Rung, run: RungRun, cases: Sequence[Case]) -> None:
    for case in cases:
        table.entries.append(Entry(rung.name, case.name, run.figures(case)))
