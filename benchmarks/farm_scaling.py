"""How a farm scales: its own plans of tasks, run in simulated time on 1 to 1000 workers.

    python benchmarks/farm_scaling.py     # draws docs/farm/scaling.png, prints the table

The tasks and their order are those of `nlens_video.farm.shots`; how long each takes is a model
whose costs were measured (`docs/farm.md`). Beside it stands the closed form of the same costs.
"""

from __future__ import annotations

import heapq
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from nlens_video.chunk_mark import ChunkMark
from nlens_video.farm.job import Prepared, length_of, prepare, ranges
from nlens_video.farm.merge import Merged, merge
from nlens_video.farm.shots import Plan, Progress, Shot, Task, plan, render_marked, render_whole
from nlens_video.settings import ObjectSettings, OutputSettings, Settings, SourceSettings

PICTURE = Path(__file__).parents[1] / "docs" / "farm" / "scaling.png"
WORKERS = (1, 2, 4, 8, 16, 32, 64, 125, 250, 500, 1000)
RATE = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """What things cost, of 960x512 in `standard` on two cores.

    Attributes:
        start_s: a worker's first task: process, libraries, kernels [s].
        chunk_s: what a chunk costs beside its frames: graph, effects measured on the shot [s].
        fit_s: of a shot [s].
        render_s: of a frame [s].
        decode_s: of a frame that is only counted or passed over [s].
        merge_s: of a frame: decoded twice, encoded once [s].
        frame_bytes: of a rendered frame in its chunk [byte].
        store_bytes_s: what the store of chunks takes in and gives out, together [byte/s].
    """

    start_s: float = 4.0
    chunk_s: float = 1.5
    fit_s: float = 2.0
    render_s: float = 0.10
    decode_s: float = 0.002
    merge_s: float = 0.02
    frame_bytes: float = 450e3
    store_bytes_s: float = 1.2e9


@dataclass(frozen=True, slots=True)
class Footage:
    """Shots of equal length."""

    words: str
    shots: int
    frames: int
    chunk_s: float = 10.0

    @property
    def hours(self) -> float:
        """Of all of it [h]."""
        return self.shots * self.frames / RATE / 3600


@dataclass(slots=True)
class Simulation:
    """Workers in simulated time; the store of chunks is one line that transfers share.

    Attributes:
        footage: what is made.
        costs: of it.
        workers: how many.
        now_s: the simulated time [s].
        store_free_s: when the line to the store is free again [s].
    """

    footage: Footage
    costs: Costs
    workers: int
    now_s: float = 0.0
    store_free_s: float = 0.0
    fresh: int = field(init=False)

    def __post_init__(self) -> None:
        self.fresh = self.workers

    def run(self) -> float:
        """Time until the last shot is merged [s]."""
        progress = Progress(self.footage.shots, lambda done, total: None)
        plans = [plan(self._shot(at), progress) for at in range(self.footage.shots)]
        order = count()
        waiting: list[tuple[int, int, Task]] = []
        awaited = [0] * len(plans)
        answers: list[list[object]] = [[] for _ in plans]
        busy: list[tuple[float, int, int, Task]] = []

        def go_on(shot: int) -> None:
            tasks = _next(plans[shot], answers[shot])
            awaited[shot], answers[shot] = len(tasks), []
            for task in tasks:
                heapq.heappush(waiting, (shot, next(order), task))

        for shot in range(len(plans)):
            go_on(shot)
        while waiting or busy:
            while waiting and len(busy) < self.workers:
                shot, _, task = heapq.heappop(waiting)
                heapq.heappush(busy, (self._ends(task), next(order), shot, task))
            self.now_s, _, shot, task = heapq.heappop(busy)
            answers[shot].append(self._answer(task))
            awaited[shot] -= 1
            if not awaited[shot]:
                go_on(shot)
        return self.now_s

    def _ends(self, task: Task) -> float:
        costs, frames = self.costs, self.footage.frames
        start = costs.start_s if self.fresh > 0 else 0.0
        self.fresh -= 1
        if task.work is prepare:
            return self.now_s + start + costs.fit_s + frames * costs.decode_s
        if task.work is render_marked:
            mark = task.arguments[1]
            assert isinstance(mark, ChunkMark)
            own = length_of(mark, frames)
            work = costs.chunk_s + mark.first * costs.decode_s + own * costs.render_s
            return self._stored(self.now_s + start + work, own)
        if task.work is render_whole:
            work = costs.chunk_s + frames * (costs.render_s + costs.merge_s - costs.decode_s)
            return self.now_s + start + work
        assert task.work is merge
        return self._stored(self.now_s + start + frames * costs.merge_s, frames)

    def _stored(self, ready_s: float, frames: int) -> float:
        """When so many frames are through the store's line, which takes one after the other."""
        took = frames * self.costs.frame_bytes / self.costs.store_bytes_s
        self.store_free_s = max(self.store_free_s, ready_s - took) + took
        return max(ready_s, self.store_free_s)

    def _answer(self, task: Task) -> object:
        if task.work is prepare:
            settings, _, chunk_s = task.arguments
            assert isinstance(settings, Settings) and isinstance(chunk_s, float)
            marks = tuple(
                ChunkMark(key="0" * 16, plate="0" * 16, first=first, end=end)
                for first, end in ranges(self.footage.frames, round(chunk_s * RATE))
            )
            return Prepared(settings=settings, marks=marks, frames=self.footage.frames)
        if task.work in (merge, render_whole):
            return Merged(output="", frames=self.footage.frames, chunks=0, notes=())
        return None

    def _shot(self, number: int) -> Shot:
        folder = Path(tempfile.gettempdir()) / "nlens-video-simulated"  # never made
        run = Settings(
            source=SourceSettings(spec=f"shot{number}.mp4"),
            scene=ObjectSettings(glb=Path("anim.glb")),
            output=OutputSettings(spec=f"out{number}.mp4"),
        )
        return Shot(settings=run, folder=folder, chunk_s=self.footage.chunk_s)


def _next(shot: Plan, answers: list[object]) -> list[Task]:
    try:
        return shot.send(answers) if answers else next(shot)
    except StopIteration:
        return []


def closed_form_s(footage: Footage, costs: Costs, workers: int) -> float:
    """The same costs in one line: the longest of what the workers, one shot and the store take."""
    frames, shots = footage.frames, footage.shots
    chunks = math.ceil(frames / (footage.chunk_s * RATE))
    passed = costs.decode_s * frames * (chunks - 1) / 2
    rendering = chunks * costs.chunk_s + passed + frames * costs.render_s
    fit = costs.fit_s + frames * costs.decode_s
    end = frames * costs.merge_s
    all_workers = costs.start_s + shots * (fit + rendering + end) / workers
    at_once = min(workers, chunks)
    one_shot = costs.start_s + fit + math.ceil(chunks / at_once) * rendering / chunks + end
    store = 2 * shots * frames * costs.frame_bytes / costs.store_bytes_s if chunks > 1 else 0.0
    return max(all_workers, one_shot, store)


def draw(footages: Sequence[Footage], costs: Costs) -> None:
    """Speed-up by workers, simulated and in closed form."""
    figure, axes = plt.subplots(figsize=(7.5, 5), layout="constrained")
    axes.plot(WORKERS, WORKERS, color="0.75", lw=1, label="workers")
    print(f"{'':34s}" + "".join(f"{n:>9d}" for n in WORKERS))
    for footage in footages:
        times = [Simulation(footage, costs, workers).run() for workers in WORKERS]
        forms = [closed_form_s(footage, costs, workers) for workers in WORKERS]
        (line,) = axes.plot(WORKERS, [times[0] / one for one in times], "o-", label=footage.words)
        axes.plot(WORKERS, [forms[0] / one for one in forms], "--", color=line.get_color(), lw=1)
        print(f"{footage.words:34s}" + "".join(f"{one:9.0f}" for one in times) + "  s")
        print(f"{'  closed form':34s}" + "".join(f"{one:9.0f}" for one in forms) + "  s")
    axes.set(xscale="log", yscale="log", xlabel="workers", ylabel="times as fast as one worker")
    axes.grid(alpha=0.3, which="both")
    axes.legend(title="dashed: closed form")
    PICTURE.parent.mkdir(exist_ok=True)
    figure.savefig(PICTURE, dpi=110)
    plt.close(figure)


def main() -> None:
    """Three kinds of footage."""
    draw(
        (
            Footage("one shot of 10 minutes", 1, 10 * 60 * RATE),
            Footage("a film: 1500 shots of 4 s", 1500, 4 * RATE),
            Footage("footage: 100 shots of 60 s", 100, 60 * RATE),
        ),
        Costs(),
    )


if __name__ == "__main__":
    main()
