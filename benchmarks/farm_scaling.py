"""How a farm scales: its own plans of tasks, run in simulated time on 1 to 1000 workers.

    python benchmarks/farm_scaling.py     # draws docs/farm/scaling.png, prints the table

The tasks and their order are those of `nlens_video.farm.tasks`; how long each takes is a model
whose costs were measured (`docs/farm.md`). Beside it stands the closed form of the same costs.
"""

from __future__ import annotations

import heapq
import math
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    Settings,
    SourceSettings,
)
from nlens_video.farm.job import PIECE_S, Prepared, length_of, ranges
from nlens_video.farm.merge import Merged
from nlens_video.farm.store import Folder
from nlens_video.farm.tasks import (
    Plan,
    Progress,
    Shot,
    Task,
    plan,
)
from nlens_video.farm.worker import Worker
from nlens_video.video.chunk_queue import ChunkMark

PICTURE = Path(__file__).parents[1] / "docs" / "farm" / "scaling.png"
WORKERS = (1, 2, 4, 8, 16, 32, 64, 125, 250, 500, 1000)
RATE = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """What things cost, of 960x512 in `standard` on two cores.

    Attributes:
        start_s: a worker's first task: process, libraries, kernels [s].
        open_s: what a worker's first chunk of a shot costs beside its frames: graph, effects [s].
        fit_s: of a shot [s].
        render_s: of a frame [s].
        decode_s: of a frame that is only counted or passed over [s].
        merge_s: of a frame: plate and chunk decoded, encoded once [s].
        frame_bytes: of a rendered frame in its chunk [byte].
        store_bytes_s: what the store of chunks takes in and gives out, together [byte/s].
    """

    start_s: float = 4.0
    open_s: float = 1.5
    fit_s: float = 2.0
    render_s: float = 0.10
    decode_s: float = 0.002
    merge_s: float = 0.01
    frame_bytes: float = 290e3
    store_bytes_s: float = 1.2e9


@dataclass(frozen=True, slots=True)
class Footage:
    """Shots of equal length."""

    words: str
    shots: int
    frames: int
    chunk_s: float = 10.0

    @property
    def piece(self) -> int:
        """Frames of a piece of a chunk, as `shots.plan` divides it [1]."""
        return round(self.chunk_s / max(1, round(self.chunk_s / PIECE_S)) * RATE)

    @property
    def hours(self) -> float:
        """Of all of it [h]."""
        return self.shots * self.frames / RATE / 3600


@dataclass(slots=True)
class SimulatedWorker:
    """Where it is.

    Attributes:
        shot: of its open run, None for a worker that has not started.
        position: first frame that the run has not seen [1].
    """

    shot: int | None = None
    position: float = math.inf


@dataclass(slots=True)
class Followed:
    """The merge of a shot: begins with the first piece of a chunk, ends after the last one.

    Attributes:
        number: of its task.
        hand: whether it is done by the process that runs the farm, beside the workers.
        ready_s: when each chunk was there, whole, by its first frame [s].
    """

    number: int
    task: Task
    hand: bool
    ready_s: dict[int, float] = field(default_factory=dict)


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
    idle: list[SimulatedWorker] = field(init=False)
    waiting: list[tuple[int, int, Task]] = field(default_factory=list)
    busy: list[tuple[float, int, int, Task, SimulatedWorker | None]] = field(default_factory=list)
    followed: dict[int, Followed] = field(default_factory=dict)
    order: Iterator[int] = field(default_factory=count)

    def __post_init__(self) -> None:
        self.idle = [SimulatedWorker() for _ in range(self.workers)]

    def run(self) -> float:
        """Time until the last shot is merged [s]."""
        progress = Progress(self.footage.shots, lambda done, total: None)
        plans = [plan(self._shot(at), progress) for at in range(self.footage.shots)]
        awaited = [0] * len(plans)
        answers: list[list[object]] = [[] for _ in plans]
        for shot in range(len(plans)):
            awaited[shot] = self._take_on(shot, _next(plans[shot], []))
        while self.waiting or self.busy:
            self._start()
            self.now_s, _, shot, task, worker = heapq.heappop(self.busy)
            if worker is not None:
                self.idle.append(worker)
            answers[shot].append(self._answer(task))
            awaited[shot] -= 1
            self._note(shot, task, awaited[shot])
            if not awaited[shot]:
                awaited[shot] = self._take_on(shot, _next(plans[shot], answers[shot]))
                answers[shot] = []
        return self.now_s

    def _take_on(self, shot: int, tasks: list[Task]) -> int:
        for task in tasks:
            if task.follows:
                hand = not any(one.hand for one in self.followed.values())
                self.followed[shot] = Followed(next(self.order), task, hand)
            else:
                heapq.heappush(self.waiting, (shot, next(self.order), task))
        return len(tasks)

    def _start(self) -> None:
        while self.waiting and self.idle:
            shot, _, task = heapq.heappop(self.waiting)
            known = (at for at, worker in enumerate(self.idle) if worker.shot == shot)
            worker = self.idle.pop(next(known, 0))
            ends = self._ends(shot, task, worker)
            heapq.heappush(self.busy, (ends, next(self.order), shot, task, worker))

    def _note(self, shot: int, task: Task, left: int) -> None:
        """A chunk is there: with the last one the end of the merge that follows is known."""
        if task.work is Worker.merge:
            self.followed.pop(shot, None)
        if task.work is not Worker.chunk:
            return
        followed = self.followed[shot]
        followed.ready_s[_pieces(task)[0].first] = self.now_s
        if left > 1:
            return
        if not followed.hand:
            heapq.heappush(self.waiting, (shot, next(self.order), followed.task))
            return
        ends, merge_s = 0.0, self.costs.merge_s
        for first, ready in sorted(followed.ready_s.items()):
            frames = min(round(self.footage.chunk_s * RATE), self.footage.frames - first)
            last = min(self.footage.piece, frames)  # the others were there before
            ends = max(ends + (frames - last) * merge_s, ready) + last * merge_s
        heapq.heappush(self.busy, (ends, next(self.order), shot, followed.task, None))

    def _ends(self, shot: int, task: Task, worker: SimulatedWorker) -> float:
        costs, frames = self.costs, self.footage.frames
        begins = self.now_s + (costs.start_s if worker.shot is None else 0.0)
        before, worker.shot = worker.shot, shot
        position, worker.position = worker.position, math.inf
        if task.work is Worker.prepare:
            return begins + costs.fit_s + frames * costs.decode_s
        if task.work is Worker.chunk:
            pieces = _pieces(task)
            first, own = pieces[0].first, sum(length_of(mark, frames) for mark in pieces)
            worker.position = first + own
            goes_on = before == shot and first >= position
            passed = first - (position if goes_on else 0)
            work = (0.0 if goes_on else costs.open_s) + passed * costs.decode_s
            return self._stored(begins + work + own * costs.render_s, own)
        if task.work is Worker.whole:
            encoding = costs.merge_s - costs.decode_s
            return begins + costs.open_s + frames * (costs.render_s + encoding)
        assert task.work is Worker.merge
        return self._stored(begins + frames * costs.merge_s, frames)

    def _stored(self, ready_s: float, frames: int) -> float:
        """When so many frames are through the store's line, which takes one after the other."""
        took = frames * self.costs.frame_bytes / self.costs.store_bytes_s
        self.store_free_s = max(self.store_free_s, ready_s - took) + took
        return max(ready_s, self.store_free_s)

    def _answer(self, task: Task) -> object:
        if task.work is Worker.prepare:
            _, _, piece_s = task.arguments
            assert isinstance(piece_s, float)
            marks = tuple(
                ChunkMark(key="0" * 16, plate="0" * 16, first=first, end=end)
                for first, end in ranges(self.footage.frames, round(piece_s * RATE))
            )
            return Prepared(fit=None, marks=marks, frames=self.footage.frames, frame_s=1 / RATE)
        if task.work in (Worker.merge, Worker.whole):
            return Merged(output="", frames=self.footage.frames, chunks=0, notes=())
        return None

    def _shot(self, number: int) -> Shot:
        folder = Path(tempfile.gettempdir()) / "nlens-video-simulated"  # never made
        run = Settings(
            source=SourceSettings(spec=f"shot{number}.mp4"),
            scene=ObjectSettings(glb=Path("anim.glb")),
            output=OutputSettings(spec=f"out{number}.mp4"),
        )
        return Shot(settings=run, store=Folder(folder), chunk_s=self.footage.chunk_s)


def _pieces(task: Task) -> tuple[ChunkMark, ...]:
    pieces = task.arguments[2]
    assert isinstance(pieces, tuple)
    return pieces


def _next(shot: Plan, answers: list[object]) -> list[Task]:
    try:
        return shot.send(answers) if answers else next(shot)
    except StopIteration:
        return []


def closed_form_s(footage: Footage, costs: Costs, workers: int) -> float:
    """The same costs in one line: the longest of what the workers, one shot and the store take."""
    frames, shots = footage.frames, footage.shots
    chunks = math.ceil(frames / (footage.chunk_s * RATE))
    at_once = min(workers, chunks)
    rendering = at_once * (costs.open_s + frames * costs.decode_s) + frames * costs.render_s
    fit = costs.fit_s + frames * costs.decode_s
    merging = frames * costs.merge_s
    whole = shots * (fit + rendering + merging)
    hand = shots * merging if chunks > 1 else 0.0  # at most what one more pair of hands can do
    all_workers = costs.start_s + max((whole - hand) / workers, whole / (workers + (hand > 0)))
    last = min(footage.piece, frames) * costs.merge_s
    rounds = math.ceil(chunks / at_once) * at_once / chunks
    first = costs.open_s + min(frames, footage.piece) * costs.render_s
    busiest = max(rounds * rendering / at_once, first + merging - last)
    one_shot = costs.start_s + fit + busiest + last
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
