"""Shots on a Ray cluster: the only module that knows Ray.

An actor is a process that stays: Python, compiled kernels and drivers are loaded once. Only
settings and paths travel; the files lie where all machines see them under one path.
"""

from __future__ import annotations

import logging
import os
import secrets
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Any

import ray
from ray.exceptions import RayError

from nlens_video.core import signals
from nlens_video.core.errors import NlensError, UsageError
from nlens_video.farm.local_worker import OwnHand
from nlens_video.farm.merge import Merged
from nlens_video.farm.shot_tasks import Plan
from nlens_video.farm.task_queue import TaskQueue, Waiting
from nlens_video.farm.worker import Worker
from nlens_video.render.select import VARIABLE, renderer_name

_CPUS = 2  # of a worker: a run keeps about two busy
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
        crew = WorkerPool(TaskQueue(plans), OwnHand() if near else None, int(self.gpus))
        try:
            if self.address is None:
                crew.begin()
            # Ray tells of a lost worker on standard output, where results belong; a note says so
            with redirect_stdout(StringIO()), _connected(self) as count:
                crew.run(count)
            return crew.finish()
        finally:
            crew.drop()


@dataclass(frozen=True, slots=True)
class _Failed:
    """An error that a person can answer for; it would come again on any machine."""

    error: NlensError


class _Worker:
    """Does one task after the other, in a process of its own."""

    def __init__(self) -> None:
        self._bench = Worker()

    def do(self, work: Callable[..., object], arguments: tuple[object, ...]) -> object:
        try:
            return work(self._bench, *arguments)
        except NlensError as error:
            return _Failed(error)


class WorkerPool:
    """Workers, and who of them does what; one task is done here, where that is of use."""

    def __init__(self, queue: TaskQueue, hand: OwnHand | None, gpus: int) -> None:
        self._most = 1
        self._gpus = gpus
        self._queue = queue
        self._hand = hand
        self._at_hand: Waiting | None = None
        self._idle: list[tuple[Any, int]] = []
        self._busy: dict[Any, tuple[Any, Waiting]] = {}

    def begin(self) -> None:
        """Do here what the first shot wants first: Ray takes seconds to start."""
        self._queue.begin(1)
        if self._hand is not None and self._queue.waiting:
            self._take_in_hand(self._hand, self._queue.next())

    def run(self, most: int) -> None:
        """Have all done that needs workers, with Ray at work and so many of them at most."""
        self._most = most
        if self._at_hand is not None:
            self._idle.append((self._hired(), 0))  # it starts meanwhile
        self._queue.begin(len(self._queue))
        while self._needed():
            self._start()
            signals.check()
            for reference in self._ready():
                self._take(reference)
            self._look_at_hand()

    def finish(self) -> list[Merged | NlensError]:
        """Do here what is left, without Ray: the end of the merge that follows the last worker."""
        while self._hand is not None and self._at_hand is not None:
            signals.check()
            self._look_at_hand(_SHORT_S)
        return self._queue.results()

    def drop(self) -> None:
        """End what is done here."""
        if self._hand is not None:
            self._hand.drop()

    def _needed(self) -> bool:
        """Whether there is, or may come, something for a worker."""
        comes = self._at_hand is not None and not self._at_hand.task.follows
        return bool(self._busy) or comes or self._queue.waiting

    def _ready(self) -> list[Any]:
        if not self._busy:
            time.sleep(_SHORT_S)
            return []
        ready, _ = ray.wait(list(self._busy), timeout=_LOOK_S)
        return list(ready)

    def _start(self) -> None:
        while self._queue.waiting and (self._idle or len(self._busy) < self._most):
            waiting = self._queue.next()
            worker = self._worker(waiting.shot)
            task = waiting.task
            self._busy[worker.do.remote(task.work, task.arguments)] = (worker, waiting)
        if self._hand is not None and self._at_hand is None:
            follower = self._queue.next_beside()
            if follower is not None:
                self._take_in_hand(self._hand, follower)

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
            self._queue.lost(waiting, str(error).splitlines()[0])
            return
        self._idle.append((worker, waiting.shot))
        self._queue.answered(waiting, answer.error if isinstance(answer, _Failed) else answer)

    def _take_in_hand(self, hand: OwnHand, waiting: Waiting) -> None:
        self._at_hand = waiting
        hand.start(waiting.task)

    def _look_at_hand(self, patience_s: float = 0.0) -> None:
        """Take what the task at hand has come to; drop it where its shot has failed."""
        if self._hand is None or self._at_hand is None:
            return
        waiting = self._at_hand
        if not self._queue.wants(waiting):
            self._hand.drop()
            self._at_hand = None
        elif self._hand.ready(patience_s):
            self._at_hand = None
            self._queue.answered(waiting, self._hand.take())


def _hear_as(handlers: dict[signal.Signals, Any]) -> None:
    """Put handlers of signals back: Ray has its own while it runs, and none when it has ended."""
    for number, handler in handlers.items():
        if handler is not None:
            signal.signal(number, handler)


@contextmanager
def _connected(cluster: Cluster) -> Iterator[int]:
    """How many workers there are to be."""
    here = threading.current_thread() is threading.main_thread()  # others hear no signals
    handlers = {number: signal.getsignal(number) for number in signals.ENDING if here}
    workers = cluster.workers or max(1, (os.cpu_count() or 1) // _CPUS)
    local = cluster.address is None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # else Ray may report to its makers
    if local:  # Ray's first autoscaler, which has nothing to do here, takes a second to end
        os.environ.setdefault("RAY_enable_autoscaler_v2", "1")
        # by itself Ray keeps one in the home folder, which a service or a container may not have
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex())
    try:
        ray.init(
            address="local" if local else cluster.address,
            num_cpus=_CPUS * workers if local else None,
            include_dashboard=False if local else None,
            logging_level=logging.ERROR,
            log_to_driver=False,
            # what is started here has this process's environment, and needs no process of its own
            runtime_env=None if local else {"env_vars": {VARIABLE: renderer_name()}},
        )
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"--address {cluster.address or 'local'}: no Ray cluster answers "
            f"({str(error).splitlines()[0]}); start one with ray start --head, or leave it out"
        ) from error
    try:
        _hear_as(handlers)
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
        _hear_as(handlers)
