"""`nlens-video evaluate scene`: the drawn object and its shadow against rendered ground truth."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from nlens_video.evaluate.bench.case import codes_of
from nlens_video.evaluate.composite.render_accuracy import measure_render, render_accuracy_table
from nlens_video.evaluate.composite.shadow import DEPTH, TRUTH, Shaded, shadow_table
from nlens_video.evaluate.console import Progress, make_folder, tell_and_write, write_texts
from nlens_video.evaluate.plates import find_plates, load_plate
from nlens_video.evaluate.tables import Table
from nlens_video.scene.scene import Scene


def evaluate_scene(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> int:
    """Draw the object of every plate and cast its shadow, print the tables and write them.

    Args:
        folder: one with a folder for each plate (see `plates`), or a plate itself; those that also
            hold `gt.png`, `bg_depth.exr`, `gt_noshadow.png` and `object.exr` tell of the shadow.
        out: gets `scene.md` and a CSV for each table; made where missing.
        as_json: print all figures as JSON instead of tables.
        quiet: print nothing but JSON.

    Returns:
        The exit code, 0.

    Raises:
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
    """
    found, _ = find_plates(folder)
    if out is not None:
        make_folder(out)
    drawn, shadows = render_accuracy_table(), shadow_table()
    for path in Progress(quiet=quiet).track(found, "drawing objects and shadows"):
        _measure(path, drawn, shadows)
    text = _markdown(drawn, shadows)
    texts = {"scene.md": text, "drawn.csv": drawn.csv(), "shadow.csv": shadows.csv()}
    printed = (
        json.dumps({t.name: t.json() for t in (drawn, shadows)}, indent=2) + "\n"
        if as_json
        else text
    )
    writing = None if out is None else partial(write_texts, out, texts)
    tell_and_write(printed, writing, quiet=quiet and not as_json)
    return 0


def _measure(path: Path, drawn: Table, shadows: Table) -> None:
    known = load_plate(path)
    rgba = codes_of(path / "object_rgba.png", known.rgb.shape[:2])
    drawn.entries.append(
        measure_render(Scene.load(path / "object.glb"), known, rgba[..., 3] / 255.0)
    )
    shaded = Shaded.load(path, known)
    if shaded is not None:
        shadows.entries.extend(shaded.measure(path))


def _markdown(drawn: Table, shadows: Table) -> str:
    names = drawn.plates()
    parts = [f"# Objects and shadows of {len(names)} plates\n\n{', '.join(names)}\n"]
    parts.append(drawn.markdown())
    if shadows.entries:
        parts.append(shadows.markdown())
    else:
        parts.append(f"No plate holds {TRUTH} and {DEPTH}: nothing is said of shadows.\n")
    return "\n".join(parts)
