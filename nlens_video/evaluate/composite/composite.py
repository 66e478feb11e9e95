"""`nlens-video evaluate composite`: composites against ground truth, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from nlens_video.evaluate.bench.measure import machine
from nlens_video.evaluate.coc.baselines import nearest_blur, quadratic_coc
from nlens_video.evaluate.composite.methods import (
    ABOUT,
    BLIND,
    DEFAULT,
    GAUSSIAN,
    NAIVE,
    TRUE_COC,
    all_methods,
    load_subject,
)
from nlens_video.evaluate.metrics import LEVEL, Interval, coc_figures, over_scenes
from nlens_video.evaluate.plates import Plate, find_plates
from nlens_video.evaluate.plots import Bar, accuracy_bars
from nlens_video.evaluate.report import (
    Column,
    Report,
    Table,
    grid,
    prepare_folder,
    rounded,
    track,
)
from nlens_video.stages.f_coc import CocNetwork, estimate_coc

QUADRATIC, NETWORK = "disparity to quadratic CoC", "our network"
_FIGURES = {
    "rmse_px": ("CoC of the plate, RMSE [px]", 2),
    "psnr_db": ("PSNR [dB]", 2),
    "ssim": ("SSIM", 3),
}
"""Heading and digits of each figure that is compared with the paper's."""

_PAPER: Mapping[str, tuple[tuple[str, str, dict[str, float]], ...]] = {
    "Table 1 of the paper: estimating the CoC, and blurring with the true CoC": (
        ("Ranftl et al.", QUADRATIC, {"rmse_px": 6.29}),
        ("Ruan et al.", NETWORK, {"rmse_px": 4.07}),
        ("Prakash et al., Gaussian", GAUSSIAN, {"psnr_db": 28.13, "ssim": 0.90}),
        ("Peng et al., network", TRUE_COC, {"psnr_db": 31.08, "ssim": 0.89}),
    ),
    "Table 2 of the paper: composites": (
        ("Naive Composites", NAIVE, {"psnr_db": 26.41, "ssim": 0.73}),
        ("Blind Aug. w/ DoF", BLIND, {"psnr_db": 27.88, "ssim": 0.82}),
        ("Ours", DEFAULT, {"psnr_db": 34.66, "ssim": 0.97}),
    ),
}
"""What the paper reports: its row, the row here that stands beside it, its figures."""

_SOURCE = (
    "The paper's figures are those of \"Parameter-Free Neural Lens Blur Rendering for "
    'High-Fidelity Composites", tables 1 (one scene, nine variations) and 2 (three scenes, nine '
    "variations). Its scenes are not published: figures measured here are of other pictures, and "
    "only the distance between rows can be compared across."
)

Intervals = Mapping[tuple[str, str], Interval]
"""Mean over scenes by name of the row and key of the figure."""


def evaluate_composite(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> None:
    """Composite on every plate of a folder by every method.

    `folder` holds a folder for each plate (see `plates`), or is one itself; each also holds
    `gt_noshadow.png` and `object.exr`. `out` gets `composite.md`, a CSV for each table and
    `composite.png`.

    Raises:
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: a plot is asked for and matplotlib is missing.
    """
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    found, passed = find_plates(folder)
    prepare_folder(out, plots=True)
    ran_on = machine()
    composites, plates_coc = _composites_table(), _plates_coc_table()
    scenes: dict[str, str] = {}
    with OnnxCocNetwork(find_model("coc").path) as network:
        for path in track(found, "measuring composites", quiet=quiet):
            subject = load_subject(path)
            plate = subject.known
            scenes[plate.name] = plate.scene_name
            for method in all_methods():
                composites.add(method.name, plate.name, method.measure(subject))
            for row, rmse_px in _plate_errors(plate, network).items():
                plates_coc.add(row, plate.name, {"rmse_px": rmse_px})
    intervals = {
        (row, key): interval
        for table in (composites, plates_coc)
        for row in table.rows()
        for key in _FIGURES
        if (interval := _over_scenes(table.by_plate(row, key), scenes)).scenes
    }
    plate_gains = _gains(composites)
    gains = {row: _over_scenes(values, scenes) for row, values in plate_gains.items()}
    heading = [f"# Composites of {len(scenes)} plates", ", ".join(scenes)]
    if passed:
        heading.append(f"Passed over, no stills: {', '.join(passed)}")
    heading.append("\n".join(f"- {name}: {value}" for name, value in ran_on.items()))
    bars = [
        Bar(
            name=row,
            psnr_db=intervals[row, "psnr_db"],
            gain_db=gains[row],
            plates_db=list(composites.by_plate(row, "psnr_db").values()),
            plate_gains_db=list(plate_gains[row].values()),
        )
        for row in composites.rows()
        if (row, "psnr_db") in intervals
    ]
    Report(
        name="composite",
        sections=[
            "\n\n".join(heading) + "\n",
            _paper_comparison(intervals),
            _scenes_section(bars, intervals),
        ],
        tables=[composites, plates_coc],
        facts={
            "machine": ran_on, "plates": list(scenes), "passed_over": passed,
            "gain_db": {row: _interval_json(interval) for row, interval in gains.items()},
        },
        plots={
            "composite.png": (
                "PSNR of each method, and its gain over naive", partial(accuracy_bars, bars),
            )
        },
    ).publish(out, as_json=as_json, quiet=quiet)  # fmt: skip


def _plate_errors(plate: Plate, network: CocNetwork) -> dict[str, float]:
    """RMSE of the whole plate's CoC by each way to estimate it [px]."""
    maps = {}
    if plate.sharp is not None:
        blur = nearest_blur(plate.rgb, plate.sharp)
        maps[QUADRATIC] = quadratic_coc(blur, plate.relative_disparity)
    maps[NETWORK] = estimate_coc(network, plate.rgb).coc_px
    return {row: coc_figures(coc, plate.true_coc_px)["rmse_px"] for row, coc in maps.items()}


def _over_scenes(figures: Mapping[str, float], scenes: Mapping[str, str]) -> Interval:
    """Mean of figures by plate over the scenes of the plates."""
    return over_scenes((scenes[plate], figure) for plate, figure in figures.items())


def _gains(composites: Table) -> dict[str, dict[str, float]]:
    """PSNR above the naive composite of the same plate, by row and plate [dB]."""
    naive = composites.by_plate(NAIVE, "psnr_db")
    return {
        row: {plate: db - naive[plate] for plate, db in composites.by_plate(row, "psnr_db").items()}
        for row in composites.rows()
    }


def _interval_json(interval: Interval) -> dict[str, float | int | None]:
    return {
        "mean": rounded(interval.mean), "half_width": rounded(interval.half),
        "scenes": interval.scenes,
    }  # fmt: skip


def _paper_comparison(found: Intervals) -> str:
    """Both tables of the paper as Markdown, with what was measured here."""
    parts = []
    for title, rows in _PAPER.items():
        cells = []
        for what, here, reported in rows:
            for key, value in reported.items():
                heading, digits = _FIGURES[key]
                interval = found.get((here, key), over_scenes(()))
                measured = interval.text(digits), str(interval.scenes)
                cells.append([what, here, heading, f"{value:.2f}", *measured])
        columns = ["row of the paper", "row here", "figure", "the paper's", "here", "scenes here"]
        parts += [f"## {title}", grid(columns, cells)]
    return "\n\n".join([*parts, _SOURCE]) + "\n"


def _scenes_section(bars: list[Bar], intervals: Intervals) -> str:
    rows = [
        [
            bar.name, bar.psnr_db.text(2), intervals[bar.name, "ssim"].text(3),
            bar.gain_db.text(2), str(bar.psnr_db.scenes),
        ]
        for bar in bars
    ]  # fmt: skip
    columns = ["", "PSNR [dB]", "SSIM", "gain over naive [dB]", "scenes"]
    return (
        f"## Over scenes\n\n{grid(columns, rows)}\n\n"
        f"Means over scenes, each the mean of its plates, ± half the {LEVEL:.0%} "
        "interval (Student's t): plates of one scene are no independent samples, and few "
        "scenes leave wide intervals. The gain is taken plate by plate.\n"
    )


def _composites_table() -> Table:
    return Table(
        name="composite",
        title="Composites against the truth",
        columns=(
            Column("psnr_db", "PSNR [dB]"),
            Column("ssim", "SSIM", 4),
            Column("band_psnr_db", "band, PSNR [dB]"),
            Column("band_ssim", "band, SSIM", 4),
            Column("object_rms_px", "object's CoC, rms [px]"),
            Column("time_s", "time [s]", 2, "median"),
            Column("psnr_db", "plates", 0, "count"),
        ),
        detail="psnr_db",
        notes=(
            "PSNR and SSIM of 8-bit code values, in the tightest box around the sharp object; "
            "band: over the pixels around its outline that the true lens mixes with the plate. "
            "Time is that of the graph on one still, networks loaded and the lens found where it "
            "is not given; the median over the plates, on a machine that may do other work. Means "
            "are over the plates on which a lens was found. The preset `reference` needs the GLB "
            "from several sides and is not among the rows.",
            ABOUT,
        ),
    )


def _plates_coc_table() -> Table:
    return Table(
        name="composite_plate_coc",
        title="CoC of the whole plate",
        columns=(Column("rmse_px", "RMSE [px]"), Column("rmse_px", "plates", 0, "count")),
        detail="rmse_px",
        notes=("The quadratic is given the true depth and the true sharp picture.",),
    )
