"""Make a scene of ground truth for a seed: plates, labels, the object and its layers.

PYTHONPATH=samples python -m truth.make --seed 1000 --out DIR [--focus front mid back]
PYTHONPATH=samples python -m truth.make --seed 1000 --out DIR --point

One folder DIR/SEED_FOCUS for each focus. Blender is found on the PATH.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from truth import develop, subject
from truth.plan import FOCALS_MM, FOCUSES, POINT_RADIUS_PX, Lens, View, draw_lens, draw_view

HERE = Path(__file__).parent
FILTER_VARIANCE_PX2 = 0.17
"""Of Cycles' Blackman-Harris filter, 1.5 px each way; measured on points in focus."""


def arguments() -> argparse.Namespace:
    """Options of the command."""
    parser = argparse.ArgumentParser(prog="truth.make", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, required=True, help="names the scene")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--focus", nargs="+", choices=[*FOCUSES, "any"], default=list(FOCUSES))
    parser.add_argument("--camera", choices=list(FOCALS_MM), default="usual", help="what is drawn")
    parser.add_argument("--samples", type=int, default=128, help="most rays of a pixel")
    parser.add_argument("--error", type=float, default=0.04, help="relative; a pixel stops there")
    parser.add_argument("--percent", type=int, default=100, help="size of the picture")
    parser.add_argument("--threads", type=int, default=0, help="of Blender; 0: all")
    parser.add_argument("--plates-only", action="store_true", help="no object")
    parser.add_argument("--composite", action="store_true", help="also gt_noshadow.png")
    parser.add_argument(
        "--shadow", action="store_true", help="also gt.png, bg_depth.exr, env.hdr; light bounces"
    )
    parser.add_argument("--point", action="store_true", help="check the law of the blur, no scene")
    return parser.parse_args()


def run_blender(job: dict[str, object], threads: int, script: str = "render.py") -> None:
    """Run a script of this folder on a job; Blender's Python takes numpy from our packages."""
    path = Path(str(job["out"])) / "job.json"
    path.write_text(json.dumps(job))
    packages = [p for p in sys.path if p.endswith("site-packages")]
    command = ["blender", "-b", "-t", str(threads), "--python-use-system-env"]
    command += ["--python-exit-code", "1", "-P", str(HERE / script), "--", str(path)]
    found = os.pathsep.join([str(HERE.parent), *packages])
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": found}, capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(f"Blender failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def check_points(view: View, lens: Lens, folder: Path, percent: int) -> list[str]:
    """Compare the law with the spread of two rendered points; a line each."""
    light = develop.read_rgb(folder / "point.exr").sum(2).astype(np.float64)
    half = light.shape[1] // 2
    lines = []
    for part, depth in (
        (light[:, :half], 0.75 * lens.focus_m),
        (light[:, half:], 2.5 * lens.focus_m),
    ):
        spread = develop.variance_px2(part) - FILTER_VARIANCE_PX2
        spread -= 0.25 * (POINT_RADIUS_PX * percent / 100.0) ** 2
        law = float(lens.coc_px(depth)) * percent / 100.0
        measured = 4.0 * np.sqrt(max(spread, 0.0))
        lines.append(
            f"seed {view.seed}: {depth:.3f} m  law {law:+.2f} px  measured {measured:.2f} px"
        )
    return lines


def main() -> None:
    """Render, develop, write."""
    given = arguments()
    if shutil.which("blender") is None:
        sys.exit("blender is not on the PATH; apt-get install blender (3.4 or later)")
    focuses = given.focus
    if "any" in focuses:
        focuses = [FOCUSES[int(np.random.default_rng([given.seed, 5]).integers(len(FOCUSES)))]]
    view = draw_view(given.seed, given.camera)
    body = subject.mesh(view)
    depths = subject.depths(view, body)
    given.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        raw = Path(name)
        job = {"seed": given.seed, "camera": given.camera, "out": name, "focuses": focuses}
        job |= {
            "samples": given.samples,
            "error": given.error,
            "percent": given.percent,
            "objects": not given.plates_only,
        }
        job |= {"composite": given.composite or given.shadow, "shadow": given.shadow}
        job |= {"point": given.point}
        run_blender(job, given.threads)
        if given.point:
            lens = draw_lens(view, focuses[0], depths)
            print("\n".join(check_points(view, lens, raw, given.percent)))
            return
        for focus in focuses:
            folder = given.out / f"{given.seed}_{focus}"
            fresh = folder.with_name(folder.name + ".new")
            shutil.rmtree(fresh, ignore_errors=True)
            fresh.mkdir()
            take = develop.Take(
                view=view, lens=draw_lens(view, focus, depths), focus=focus, raw=raw
            )
            develop.write_plate(take, fresh, given.samples)
            develop.write_glb(view, body, take.sun, fresh)
            if not given.plates_only:
                develop.write_object(take, fresh)
            shutil.rmtree(folder, ignore_errors=True)
            fresh.replace(folder)


if __name__ == "__main__":
    main()
