"""Rendering of shots on a Ray cluster and in this process; the only module that imports Ray.

Each worker of Ray is an actor, a process that lives for the whole run, so that Python, compiled
kernels and drivers are loaded once. Only settings and paths are sent; all machines see the files
under one path.
"""

from __future__ import annotations

import logging
import os
import secrets
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, redirect_stdout
from io import StringIO
from typing import Any

import ray
from msgspec import Struct
from ray.exceptions import RayError

from nlens_video.core import signals
from nlens_video.core.errors import NlensError, UsageError
from nlens_video.farm.merge import Merged
from nlens_video.farm.ray_folder import ray_folder, restore_handlers
from nlens_video.farm.tasks import Plan, QueuedTask, Task, TaskQueue
from nlens_video.farm.worker import Worker
from nlens_video.render.select import VARIABLE, renderer_name

_CPUS = 2  # of a worker: a run uses about two
_POLL_S = 0.5  # interval of polling for interruptions while workers are busy
_IDLE_POLL_S = 0.05  # the same while only this process works


class Cluster(Struct, frozen=True, kw_only=True):
    """The Ray cluster that renders.

    Attributes:
        address: of a Ray cluster, `auto`, `ray://HOST:PORT` or `HOST:PORT`; None for one on this
            machine that ends with the run.
        workers: number of workers, None for one per two processors or per GPU.
        gpus: whether each worker needs a GPU of its own.
    """

    address: str | None = None
    workers: int | None = None
    gpus: bool = False

    def run(self, plans: Sequence[Plan]) -> list[Merged | NlensError]:
        """Render shots; a lost worker is replaced and its task repeated.

        Args:
            plans: of the shots; earlier ones have priority.

        Returns:
            Result or error of each shot; a failure does not stop the others.

        Raises:
            UsageError: there is no such cluster, or it has no GPU where one is needed.
        """
        # a Ray client may not see the files
        local = self.address is None or not self.address.startswith("ray://")
        pool = WorkerPool(TaskQueue(plans), local=local, gpus=int(self.gpus))
        try:
            if self.address is None:
                pool.begin()
            # Ray reports lost workers on standard output, which is for results; a note reports them
            with (
                redirect_stdout(StringIO()),
                ray_folder(local=self.address is None) as folder,
                _connected(self, folder) as count,
            ):
                pool.run(count)
            return pool.finish()
        finally:
            pool.cancel()


class _RemoteWorker:
    """Ray actor that runs one task after the other."""

    def __init__(self) -> None:
        self._worker = Worker()

    def do(self, work: Callable[..., object], arguments: tuple[object, ...]) -> object:
        try:
            return work(self._worker, *arguments)
        except NlensError as error:
            return error  # the task would fail on any machine


class _Cancelled(Exception):
    """The local task was cancelled."""


class LocalWorker:
    """Runs one task in a thread of this process; the task polls for cancellation."""

    def __init__(self) -> None:
        self._thread: threading.Thread | None = None
        self._cancelled = threading.Event()
        self._answer: object = None

    def start(self, task: Task) -> None:
        """Start a task; one that follows others is called with `poll`, which it calls often."""
        polling = {"poll": self._poll} if task.follows else {}

        def work() -> None:
            try:
                with closing(Worker()) as worker:
                    self._answer = task.work(worker, *task.arguments, **polling)
            except BaseException as error:  # noqa: BLE001 - raised by `take`
                self._answer = error

        self._cancelled.clear()
        self._thread = threading.Thread(target=work, name="nlens-local-worker", daemon=True)
        self._thread.start()

    def ready(self, patience_s: float) -> bool:
        """Whether the task has ended; waits at most `patience_s` for it [s]."""
        if self._thread is not None:
            self._thread.join(patience_s)
        return self._thread is None or not self._thread.is_alive()

    def take(self) -> object:
        """What the task returned, or the `NlensError` that it raised, once it is `ready`.

        Raises:
            Whatever else it raised.
        """
        self._thread = None
        if isinstance(self._answer, BaseException) and not isinstance(self._answer, NlensError):
            raise self._answer
        return self._answer

    def cancel(self) -> None:
        """Cancel the task; it removes its partial files."""
        if self._thread is not None:
            self._cancelled.set()
            self._thread.join()
            self._thread = None

    def _poll(self) -> None:
        if self._cancelled.is_set():
            raise _Cancelled


class WorkerPool:
    """Distributes tasks to Ray workers and, where it can, one task to this process."""

    def __init__(self, queue: TaskQueue, *, local: bool, gpus: int) -> None:
        self._most = 1
        self._gpus = gpus
        self._queue = queue
        self._uses_local = local
        self._local = LocalWorker()
        self._local_task: QueuedTask | None = None
        self._idle: list[tuple[Any, int]] = []
        self._busy: dict[Any, tuple[Any, QueuedTask]] = {}

    def begin(self) -> None:
        """Start the first task of the first shot here, since Ray takes seconds to start."""
        self._queue.begin(1)
        if self._uses_local and self._queue.waiting:
            self._local_task = self._queue.next()
            self._local.start(self._local_task.task)

    def run(self, most: int) -> None:
        """Run all tasks that need workers, on at most `most` of them; Ray is initialised."""
        self._most = most
        if self._local_task is not None:
            self._idle.append((self._new_worker(), 0))  # starts in the meantime
        self._queue.begin(len(self._queue))
        while self._needed():
            self._start()
            signals.check()
            for reference in self._ready():
                self._take(reference)
            self._poll_local_task()

    def finish(self) -> list[Merged | NlensError]:
        """Wait for the local task, without Ray: the end of the merge after the last chunk."""
        while self._local_task is not None:
            signals.check()
            self._poll_local_task(_IDLE_POLL_S)
        return self._queue.results()

    def cancel(self) -> None:
        """Cancel the local task."""
        self._local.cancel()

    def _needed(self) -> bool:
        """Whether there is or will be a task for a worker."""
        coming = self._local_task is not None and not self._local_task.task.follows
        return bool(self._busy) or coming or self._queue.waiting

    def _ready(self) -> list[Any]:
        if not self._busy:
            time.sleep(_IDLE_POLL_S)
            return []
        ready, _ = ray.wait(list(self._busy), timeout=_POLL_S)
        return list(ready)

    def _start(self) -> None:
        while self._queue.waiting and (self._idle or len(self._busy) < self._most):
            waiting = self._queue.next()
            worker = self._worker(waiting.shot)
            task = waiting.task
            self._busy[worker.do.remote(task.work, task.arguments)] = (worker, waiting)
        if self._uses_local and self._local_task is None:
            self._local_task = self._queue.next_follower()
            if self._local_task is not None:
                self._local.start(self._local_task.task)

    def _worker(self, shot: int) -> Any:  # noqa: ANN401  # Ray's handles have no type of their own
        """An idle worker, if possible one that has the shot open."""
        if not self._idle:
            return self._new_worker()
        known = next((at for at, (_, last) in enumerate(self._idle) if last == shot), 0)
        return self._idle.pop(known)[0]

    def _new_worker(self) -> Any:  # noqa: ANN401  # Ray's handles have no type
        kind = ray.remote(num_cpus=_CPUS, num_gpus=self._gpus, max_restarts=0)(_RemoteWorker)
        return kind.remote()

    def _take(self, reference: Any) -> None:  # noqa: ANN401  # Ray's references have no type
        worker, waiting = self._busy.pop(reference)
        try:
            answer = ray.get(reference)
        except RayError as error:
            self._queue.lost(waiting, str(error).splitlines()[0])
            return
        self._idle.append((worker, waiting.shot))
        self._queue.answered(waiting, answer)

    def _poll_local_task(self, patience_s: float = 0.0) -> None:
        """Take the result of the local task; cancel it where its shot has failed."""
        waiting = self._local_task
        if waiting is None:
            return
        if not self._queue.wants(waiting):
            self._local.cancel()
            self._local_task = None
        elif self._local.ready(patience_s):
            self._local_task = None
            self._queue.answered(waiting, self._local.take())


@contextmanager
def _connected(cluster: Cluster, folder: str | None) -> Iterator[int]:
    """Connect to Ray, its files in a folder; yields the number of workers to use."""
    main = threading.current_thread() is threading.main_thread()  # others get no signals
    handlers = {number: signal.getsignal(number) for number in signals.ENDING if main}
    workers = cluster.workers or max(1, (os.cpu_count() or 1) // _CPUS)
    local = cluster.address is None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Ray sends usage statistics by default
    if local:  # version 1 of the autoscaler takes a second to end
        os.environ.setdefault("RAY_enable_autoscaler_v2", "1")
        # by default Ray stores one in the home folder, which a service or container may not have
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex())
    try:
        ray.init(
            address="local" if local else cluster.address,
            num_cpus=_CPUS * workers if local else None,
            include_dashboard=False if local else None,
            logging_level=logging.ERROR,
            log_to_driver=False,
            # local workers inherit the environment; a runtime environment would need a process
            runtime_env=None if local else {"env_vars": {VARIABLE: renderer_name()}},
            _temp_dir=folder,
        )
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        raise UsageError(
            f"--address {cluster.address or 'local'}: no Ray cluster answers "
            f"({str(error).splitlines()[0]}); start one with ray start --head, or leave it out"
        ) from error
    except SystemExit as ended:  # Ray's own handler of SIGTERM
        raise KeyboardInterrupt from ended
    try:
        restore_handlers(handlers)
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
        restore_handlers(handlers)
