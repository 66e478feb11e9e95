"""Shots on a Ray cluster: the only module that knows Ray.

An actor is a process that stays: Python, compiled kernels and drivers are loaded once. Only
settings and paths travel; the files lie where all machines see them under one path.
"""

from __future__ import annotations

import logging
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Any

import ray
from ray.exceptions import RayError

from nlens_video import interrupts
from nlens_video.backends.choose_renderer import VARIABLE, renderer_name
from nlens_video.errors import NlensError, UsageError
from nlens_video.farm.merge import Merged
from nlens_video.farm.own_hand import OwnHand
from nlens_video.farm.shots import Plan, Task
from nlens_video.farm.workbench import Workbench
from nlens_video.video.atomic import sweep

_CPUS = 2  # of a worker: a run keeps about two busy
_MOST_TRIES = 3  # of one chunk, before it counts as what kills its workers
_LOOK_S = 0.5  # from one look for an interruption to the next
_SHORT_S = 0.05  # the same where nothing but this process is at work


@dataclass(frozen=True, slots=True, kw_only=True)
class Cluster:
    """Who renders.

    Attributes:
        address: of a Ray cluster, `auto`, `ray://HOST:PORT` or `HOST:PORT`; None for one on this
            machine that ends with the run.
        workers: how many, None for one to every two processors, or to every GPU.
        gpus: whether each worker needs a GPU of its own.
    """

    address: str | None = None
    workers: int | None = None
    gpus: bool = False

    def run(self, plans: Sequence[Plan]) -> list[Merged | NlensError]:
        """Have shots made; a worker that is lost is replaced, and its task done again.

        Args:
            plans: of the shots; earlier ones go first where workers are few.

        Returns:
            What was merged, or what failed, shot by shot: one that fails does not stop the others.

        Raises:
            UsageError: there is no such cluster, or it has no GPU where one is needed.
        """
        # a client has no such files
        near = self.address is None or not self.address.startswith("ray://")
        crew = _Crew(plans, OwnHand() if near else None, int(self.gpus))
        try:
            if self.address is None:
                crew.begin()
            with _connected(self) as count:
                return crew.run(count)
        finally:
            crew.drop()


@dataclass(frozen=True, slots=True)
class _Failed:
    """An error that a person can answer for; it would come again on any machine."""

    error: NlensError


class _Worker:
    """Does one task after the other, in a process of its own."""

    def __init__(self) -> None:
        self._bench = Workbench()

    def do(self, work: Callable[..., object], arguments: tuple[object, ...]) -> object:
        try:
            return work(self._bench, *arguments)
        except NlensError as error:
            return _Failed(error)


@dataclass(slots=True)
class _Running:
    """A shot on its way: answers of the tasks that it waits for, and who follows them."""

    plan: Plan
    answers: list[object]
    awaited: int = 0
    follower: _Waiting | None = None
    result: Merged | NlensError | None = None


@dataclass(order=True, frozen=True, slots=True)
class _Waiting:
    """A task of a shot, in the order in which they are done."""

    shot: int
    number: int
    task: Task = field(compare=False)


class _Crew:
    """Workers, and who of them does what; one task is done here, where that is of use."""

    def __init__(self, plans: Sequence[Plan], hand: OwnHand | None, gpus: int) -> None:
        self._most = 1
        self._gpus = gpus
        self._hand = hand
        self._at_hand: _Waiting | None = None
        self._idle: list[tuple[Any, int]] = []
        self._busy: dict[Any, tuple[Any, _Waiting]] = {}
        self._waiting: list[_Waiting] = []
        self._tries: Counter[tuple[int, str]] = Counter()
        self._shots = [_Running(plan, []) for plan in plans]
        self._begun = 0

    def begin(self) -> None:
        """Do here what the first shot wants first: Ray takes seconds to start."""
        self._go_on(0, None)
        self._begun = 1
        if self._hand is not None and len(self._waiting) == 1:
            self._at_hand = self._waiting.pop()
            self._hand.start(self._at_hand.task)

    def run(self, most: int) -> list[Merged | NlensError]:
        """Have all shots made, with Ray at work and so many workers at most."""
        self._most = most
        if self._at_hand is not None:
            self._idle.append((self._hired(), 0))  # it starts meanwhile
        for number in range(self._begun, len(self._shots)):
            self._go_on(number, None)
        while self._waiting or self._busy or self._at_hand is not None:
            self._start()
            interrupts.look()
            for reference in self._ready():
                self._take(reference)
            self._look_at_hand()
        return [shot.result for shot in self._shots if shot.result is not None]

    def drop(self) -> None:
        """End what is done here."""
        if self._hand is not None:
            self._hand.drop()

    def _ready(self) -> list[Any]:
        if not self._busy:
            time.sleep(_SHORT_S)
            return []
        ready, _ = ray.wait(list(self._busy), timeout=_LOOK_S)
        return list(ready)

    def _start(self) -> None:
        while self._waiting and (self._idle or len(self._busy) < self._most):
            waiting = heappop(self._waiting)
            if self._shots[waiting.shot].result is not None:
                continue  # its shot has failed
            worker = self._worker(waiting.shot)
            task = waiting.task
            self._tries[waiting.shot, task.words] += 1
            self._busy[worker.do.remote(task.work, task.arguments)] = (worker, waiting)

    def _worker(self, shot: int) -> Any:  # noqa: ANN401  # Ray's handles have no type of their own
        """One with nothing to do, who knows the shot if there is such a one."""
        if not self._idle:
            return self._hired()
        known = next((at for at, (_, last) in enumerate(self._idle) if last == shot), 0)
        return self._idle.pop(known)[0]

    def _hired(self) -> Any:  # noqa: ANN401  # Ray's handles have no type
        kind = ray.remote(num_cpus=_CPUS, num_gpus=self._gpus, max_restarts=0)(_Worker)
        return kind.remote()

    def _take(self, reference: Any) -> None:  # noqa: ANN401  # Ray's references have no type
        worker, waiting = self._busy.pop(reference)
        try:
            answer = ray.get(reference)
        except RayError as error:
            self._lost(waiting, error)
            return
        self._idle.append((worker, waiting.shot))
        self._answered(waiting, answer.error if isinstance(answer, _Failed) else answer)

    def _look_at_hand(self) -> None:
        """Take what the task at hand has come to; drop it where its shot has failed."""
        if self._hand is None or self._at_hand is None:
            return
        waiting, answer = self._at_hand, self._hand.take()
        failed = self._shots[waiting.shot].result is not None
        if failed:
            self._hand.drop()
        if failed or answer is not None:
            self._at_hand = None
            self._answered(waiting, answer)

    def _answered(self, waiting: _Waiting, answer: object) -> None:
        shot = self._shots[waiting.shot]
        if shot.result is not None:
            return
        if isinstance(answer, NlensError):
            shot.result = answer
            return
        waiting.task.done(answer)
        shot.answers[waiting.number] = answer
        shot.awaited -= 1
        if not shot.awaited:
            self._go_on(waiting.shot, shot.answers)
        elif shot.awaited == 1 and shot.follower is not None:
            heappush(self._waiting, shot.follower)
            shot.follower = None

    def _go_on(self, number: int, answers: list[object] | None) -> None:
        """Give a shot its answers, and take what it wants done next."""
        shot = self._shots[number]
        try:
            tasks = next(shot.plan) if answers is None else shot.plan.send(answers)
        except StopIteration as end:
            shot.result = end.value
            return
        except NlensError as error:
            shot.result = error
            return
        shot.answers, shot.awaited = [None] * len(tasks), len(tasks)
        for at, task in enumerate(tasks):
            waiting = _Waiting(number, at, task)
            if not task.follows or len(tasks) == 1:
                heappush(self._waiting, waiting)
            elif self._hand is not None and self._at_hand is None:
                self._at_hand = waiting
                self._hand.start(task)
            else:
                shot.follower = waiting

    def _lost(self, waiting: _Waiting, error: RayError) -> None:
        task = waiting.task
        if task.file is not None:
            sweep(task.file)  # what it has left
        if self._tries[waiting.shot, task.words] < _MOST_TRIES:
            heappush(self._waiting, waiting)
            return
        reason = str(error).splitlines()[0]
        self._shots[waiting.shot].result = NlensError(
            f"{task.words}: {_MOST_TRIES} workers were lost over it ({reason}); render it alone "
            "with -v to see why"
        )


@contextmanager
def _connected(cluster: Cluster) -> Iterator[int]:
    """How many workers there are to be."""
    workers = cluster.workers or max(1, (os.cpu_count() or 1) // _CPUS)
    local = cluster.address is None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # else Ray may report to its makers
    try:
        ray.init(
            address="local" if local else cluster.address,
            num_cpus=_CPUS * workers if local else None,
            include_dashboard=False if local else None,
            logging_level=logging.ERROR,
            log_to_driver=False,
            runtime_env={"env_vars": {VARIABLE: renderer_name()}},
        )
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"--address {cluster.address or 'local'}: no Ray cluster answers "
            f"({str(error).splitlines()[0]}); start one with ray start --head, or leave it out"
        ) from error
    try:
        # Ray leaves this function without types
        found: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        if cluster.address and cluster.workers is None:
            workers = max(1, int(found.get("CPU", _CPUS)) // _CPUS)
        if cluster.gpus:
            gpus = int(found.get("GPU", 0))
            if not gpus:
                raise UsageError(
                    "--device cuda: the cluster declares no GPU; start its machines with ray start "
                    "--num-gpus N, or use --device cpu"
                )
            workers = min(workers, gpus)
        yield workers
    finally:
        ray.shutdown()
