"""`nlens-video evaluate composite`: whole composites against rendered ground truth."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from nlens_video.evaluate.bench.report import machine
from nlens_video.evaluate.coc.quadratic import nearest_blur, quadratic_coc
from nlens_video.evaluate.composite.methods import all_methods
from nlens_video.evaluate.composite.paper_figures import NETWORK, QUADRATIC
from nlens_video.evaluate.composite.report import Report
from nlens_video.evaluate.composite.subject import load_subject
from nlens_video.evaluate.console import Progress, check_matplotlib, make_folder, tell_and_write
from nlens_video.evaluate.metrics import coc_figures
from nlens_video.evaluate.plates import Plate, find_plates
from nlens_video.evaluate.tables import Entry
from nlens_video.stages.f_coc import CocNetwork, estimate_coc


def evaluate_composite(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> int:
    """Composite on every plate of a folder by every method, print the tables and write them.

    Args:
        folder: one with a folder for each plate (see `plates`), or a plate itself; each also holds
            `gt_noshadow.png` and `object.exr`.
        out: gets `composite.md`, a CSV for each table and `composite.png`; made where missing.
        as_json: print all figures as JSON instead of tables.
        quiet: print nothing but JSON.

    Returns:
        The exit code, 0.

    Raises:
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: a plot is asked for and matplotlib is missing.
    """
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    if out is not None:
        check_matplotlib()
    found, passed = find_plates(folder)
    if out is not None:
        make_folder(out)
    report = Report(machine=machine(), passed=tuple(path.name for path in passed))
    with OnnxCocNetwork(find_model("coc").path) as network:
        for path in Progress(quiet=quiet).track(found, "measuring composites"):
            _measure(path, network, report)
    text = report.json() if as_json else report.markdown()
    write = None if out is None else partial(report.write, out)
    tell_and_write(text, write, quiet=quiet and not as_json)
    return 0


def _measure(path: Path, network: CocNetwork, report: Report) -> None:
    subject = load_subject(path)
    plate = subject.known
    report.scenes[plate.name] = plate.scene
    for method in all_methods():
        entry = Entry(method.name, plate.name, method.measure(subject))
        report.composites.entries.append(entry)
    for row, rmse_px in _plate_errors(plate, network).items():
        report.plates_coc.entries.append(Entry(row, plate.name, {"rmse_px": rmse_px}))


def _plate_errors(plate: Plate, network: CocNetwork) -> dict[str, float]:
    """RMSE of the whole plate's CoC by each way to estimate it [px]."""
    maps = {}
    if plate.sharp is not None:
        blur = nearest_blur(plate.rgb, plate.sharp)
        maps[QUADRATIC] = quadratic_coc(blur, plate.relative_disparity)
    maps[NETWORK] = estimate_coc(network, plate.rgb).coc_px
    return {row: coc_figures(coc, plate.true_coc_px).rmse_px for row, coc in maps.items()}
