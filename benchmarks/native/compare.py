"""Three kernels, compiled by numba and by a C++ compiler: are they equal, and how fast is each?

  pip install nanobind
  cmake -S benchmarks/native -B BUILD -DPython_EXECUTABLE=$(which python) && cmake --build BUILD
  python benchmarks/native/compare.py BUILD

The arguments are recorded from composites of the sample by the software rasteriser, so that both
work on what a run works on. Times are of the calling thread.
"""

from __future__ import annotations

import argparse
import copy
import importlib
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np

from nlens_video import Compositor
from nlens_video.kernels.scatter import scatter
from nlens_video.render.software import raster
from nlens_video.video.pixels import blend

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = 40
MOST_CALLS = 12
LEVELS = ("baseline", "v3", "v4")
Call = tuple[object, ...]
Kernel = Callable[..., object]


def record(preset: str) -> dict[str, list[Call]]:
    """Arguments of the kernels in composites of three frames, as they were before the call."""
    calls: dict[str, list[Call]] = {"scatter_rows": [], "fill": [], "composite_over": []}

    def recording(name: str, kernel: Kernel) -> Kernel:
        def call(*args: object) -> object:
            calls[name].append(copy.deepcopy(args))
            return kernel(*args)

        return call

    def blending(function: Kernel, dtype: str) -> Kernel:
        made = compiled(function, dtype)
        return recording("composite_over", made) if function is blend._composite_over else made

    before, compiled = (scatter.scatter_rows, raster.fill), blend._compiled
    scatter.scatter_rows = recording("scatter_rows", scatter.scatter_rows)
    raster.fill = recording("fill", raster.fill)
    blend._compiled = blending
    with (
        Compositor(ROOT / "samples" / "anim.glb", preset=preset) as lens,
        av.open(str(ROOT / "samples" / "in.mp4")) as plate,
    ):
        for frame, _ in zip(plate.decode(video=0), range(3), strict=False):
            lens.process_av(frame)
    (scatter.scatter_rows, raster.fill), blend._compiled = before, compiled
    return calls


def results(name: str, args: Call) -> list[np.ndarray]:
    """The arrays that a kernel fills in, as far as it does."""
    if name == "scatter_rows":
        rows = slice(*args[9])
        return [args[7][rows]]
    if name == "fill":
        lines, columns = slice(args[1], args[2] + 1), slice(args[5])
        return [args[6][lines, columns], args[7][lines, columns]]
    return list(args[0])


def largest_difference(name: str, calls: list[Call], one: Kernel, other: Kernel) -> float:
    """Of all numbers that two kernels make, relative to the largest."""
    largest = 0.0
    for args in calls:
        mine, yours = copy.deepcopy(args), copy.deepcopy(args)
        one(*mine)
        other(*yours)
        for a, b in zip(results(name, mine), results(name, yours), strict=True):
            if a.size:
                a, b = a.astype(np.float64), b.astype(np.float64)
                largest = max(largest, np.abs(a - b).max() / max(np.abs(a).max(), 1e-30))
    return largest


def processor_time(kernel: Kernel, calls: list[Call]) -> float:
    """Of all calls [s], on copies whose making does not count."""
    total = 0.0
    for args in calls:
        mine = copy.deepcopy(args)
        start = time.thread_time()
        kernel(*mine)
        total += time.thread_time() - start
    return total


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build", type=Path, help="folder of the compiled module")
    sys.path.insert(0, str(parser.parse_args().build))
    os.environ["NLENS_RENDERER"] = "software"
    native = importlib.import_module("nlens_native")
    by_numba = {
        "scatter_rows": scatter.scatter_rows,
        "fill": raster.fill,
        "composite_over": blend._compiled(blend._composite_over, "uint8"),
    }
    print("| preset, kernel | difference |" + "".join(f" {level} |" for level in LEVELS))
    print("| --- |" + " ---: |" * (1 + len(LEVELS)))
    for preset in ("draft", "realtime"):
        for name, calls in record(preset).items():
            kernel, other = getattr(native, name), by_numba[name]
            row = f"| {preset}, {name} | {largest_difference(name, calls, other, kernel):.0e} |"
            some = calls[:: max(1, len(calls) // MOST_CALLS)]
            for level in LEVELS:
                if native.choose(level) != level:
                    row += " – |"
                    continue
                ratios = []
                for _ in range(ROUNDS):
                    theirs = processor_time(other, some)
                    ratios.append(processor_time(kernel, some) / theirs)
                row += f" {statistics.median(ratios):.2f} |"
            print(row, flush=True)


if __name__ == "__main__":
    main()
