"""`nlens-video evaluate coc`: stages F and R against rendered ground truth."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from nlens_video.evaluate.coc import plots
from nlens_video.evaluate.coc.protocol import CocProtocol
from nlens_video.evaluate.console import (
    Progress,
    check_matplotlib,
    make_folder,
    tell_and_write,
    write_texts,
)
from nlens_video.evaluate.plates import find_plates, load_plate
from nlens_video.video.atomic_files import replacing


def evaluate_coc(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> int:
    """Measure every plate of a folder, print the tables and write them where asked.

    Args:
        folder: one with a folder for each plate (see `plates`), or a plate itself.
        out: gets `coc.md`, a CSV for each table, and the plots; made where it is missing.
        as_json: print all figures as JSON instead of tables.
        quiet: print nothing but JSON.

    Returns:
        The exit code, 0.

    Raises:
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: plots are asked for and matplotlib is missing.
    """
    if out is not None:
        check_matplotlib()
    found, passed = find_plates(folder)
    if out is not None:
        make_folder(out)
    protocol = _measured(found, Progress(quiet=quiet))
    text = _as_json(protocol, passed) if as_json else _as_markdown(protocol, passed)
    write = None if out is None else partial(_write, protocol, out)
    tell_and_write(text, write, quiet=quiet and not as_json)
    return 0


def _measured(folders: list[Path], show: Progress) -> CocProtocol:
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    with OnnxCocNetwork(find_model("coc").path) as network:
        protocol = CocProtocol(network)
        for folder in show.track(folders, "measuring plates"):
            protocol.measure(load_plate(folder))
    return protocol


def _as_markdown(protocol: CocProtocol, passed: list[Path]) -> str:
    names = protocol.methods.plates()
    heading = f"# CoC of {len(names)} plates\n\n{', '.join(names)}\n"
    left = [f"Passed over, no stills: {', '.join(path.name for path in passed)}\n"] * bool(passed)
    return "\n".join([heading, *left, *(table.markdown() for table in protocol.tables)])


def _as_json(protocol: CocProtocol, passed: list[Path]) -> str:
    figures = {
        "plates": protocol.methods.plates(),
        "passed_over": [path.name for path in passed],
        **{table.name: table.json() for table in protocol.tables},
    }
    return json.dumps(figures, indent=2) + "\n"


def _write(protocol: CocProtocol, out: Path) -> None:
    texts = {f"{table.name}.csv": table.csv() for table in protocol.tables}
    texts["coc.md"] = _as_markdown(protocol, []) + (
        "\n![reliability](reliability.png)\n![error by true CoC](error_by_coc.png)\n"
    )
    write_texts(out, texts)
    writers = {
        "reliability.png": partial(plots.plot_reliability, protocol.errors),
        "error_by_coc.png": partial(plots.plot_error_by_coc, protocol.errors),
    }
    for name, write in writers.items():
        with replacing(out / name) as partial_path:
            write(partial_path)
