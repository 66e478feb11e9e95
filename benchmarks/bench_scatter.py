"""Time the scatter, fine and draft, against a Gaussian blur of the same region, in the same run.

Run: python benchmarks/bench_scatter.py. Each figure is the least of several repeats; the ratio says
more than the milliseconds, which depend on what else the machine does.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from nlens_video.kernels.scatter.scatter import DRAFT, scatter


def least_ms(work: Callable[[], object], repeats: int = 10) -> float:
    """The quickest of several runs after one to warm up [ms]."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def main() -> None:
    """Print one line a size and CoC."""
    print(
        "object      CoC [px]   1 thread [ms]  2 threads [ms]  draft, 2 [ms]  Gaussian [ms]  ratio"
    )
    for height, width in ((100, 50), (400, 200), (512, 960)):
        for least, largest in ((0, 2), (-5, 5), (-28, 28), (28, 28), (-128, 128)):
            margin = 16
            rgba = np.zeros((height + 2 * margin, width + 2 * margin, 4), dtype=np.float32)
            rgba[margin:-margin, margin:-margin] = 1.0
            rows = np.linspace(least, largest, rgba.shape[0], dtype=np.float32)
            coc = np.repeat(rows[:, None], rgba.shape[1], axis=1)
            one = least_ms(lambda rgba=rgba, coc=coc: scatter(rgba, coc, threads=1))
            two = least_ms(lambda rgba=rgba, coc=coc: scatter(rgba, coc, threads=2))
            draft = least_ms(lambda rgba=rgba, coc=coc: scatter(rgba, coc, threads=2, detail=DRAFT))
            sigma = max(largest / 4.0, 0.5)
            plain = least_ms(lambda rgba=rgba, s=sigma: cv2.GaussianBlur(rgba, (0, 0), s))
            size = f"{width}x{height}"
            print(
                f"{size:10}  {least:4.0f}..{largest:3.0f}  {one:13.1f}  {two:14.1f}  "
                f"{draft:13.1f}  {plain:13.2f}  {two / plain:5.1f}"
            )


if __name__ == "__main__":
    main()
