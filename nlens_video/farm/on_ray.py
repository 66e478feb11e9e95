"""Chunks on a Ray cluster: the only module that knows Ray.

An actor is a process that stays: Python, compiled kernels and drivers are loaded once. Only
settings, marks and paths travel; the files lie where all machines see them under one path.
"""

from __future__ import annotations

import logging
import os
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError

from nlens_video import interrupts
from nlens_video.backends.choose_renderer import VARIABLE, renderer_name
from nlens_video.chunk_mark import ChunkMark
from nlens_video.errors import NlensError, UsageError
from nlens_video.settings import Settings
from nlens_video.video.atomic import sweep

_CPUS = 2  # of a worker: a run keeps about two busy
_MOST_TRIES = 3  # of one chunk, before it counts as what kills its workers
_LOOK_S = 0.5  # from one look for an interruption to the next


@dataclass(frozen=True, slots=True, kw_only=True)
class Cluster:
    """Who renders.

    Attributes:
        address: of a Ray cluster, `auto`, `ray://HOST:PORT` or `HOST:PORT`; None for one on this
            machine that ends with the run.
        workers: how many, None for one to every two processors.
    """

    address: str | None = None
    workers: int | None = None

    def render(
        self,
        settings: Settings,
        marks: list[ChunkMark],
        folder: Path,
        on_done: Callable[[ChunkMark], None],
    ) -> None:
        """Render chunks; a worker that is lost is replaced, and its chunk rendered again.

        Args:
            settings: the run, its paths absolute.
            marks: the chunks to render.
            folder: where they go, absolute.
            on_done: called with each that is done.

        Raises:
            UsageError: there is no such cluster.
            NlensError: what a chunk failed of, or that it lost worker after worker.
        """
        with _connected(self) as count:
            _Crew(min(count, len(marks)), settings, folder).render(marks, on_done)


@dataclass(frozen=True, slots=True)
class _Failed:
    """An error that a person can answer for; it would come again on any machine."""

    error: NlensError


class _Worker:
    """Renders one chunk after the other, in a process of its own."""

    def render(self, settings: Settings, mark: ChunkMark, folder: Path) -> _Failed | None:
        from nlens_video.farm.chunk import mark_of, write_chunk

        try:
            seen = mark_of(settings)
            if (seen.key, seen.plate) != (mark.key, mark.plate):
                raise UsageError(
                    "a worker sees other files, or has another version or renderer, than the "
                    "machine that asked; give all of them the same"
                )
            write_chunk(settings, mark, folder)
        except NlensError as error:
            return _Failed(error)
        return None


class _Crew:
    """Workers, and who of them renders what."""

    def __init__(self, count: int, settings: Settings, folder: Path) -> None:
        self._settings = settings
        self._folder = folder
        self._idle: deque[Any] = deque(_hired() for _ in range(count))
        self._busy: dict[Any, tuple[Any, ChunkMark]] = {}
        self._tries: Counter[ChunkMark] = Counter()

    def render(self, marks: list[ChunkMark], on_done: Callable[[ChunkMark], None]) -> None:
        waiting = deque(marks)
        while waiting or self._busy:
            while waiting and self._idle:
                self._start(waiting.popleft())
            ready, _ = ray.wait(list(self._busy), timeout=_LOOK_S)
            interrupts.look()
            for reference in ready:
                worker, mark = self._busy.pop(reference)
                try:
                    answer = ray.get(reference)
                except RayError as error:
                    self._lost(mark, error)
                    waiting.append(mark)
                    continue
                if isinstance(answer, _Failed):
                    raise answer.error
                self._idle.append(worker)
                on_done(mark)

    def _start(self, mark: ChunkMark) -> None:
        worker = self._idle.popleft()
        self._tries[mark] += 1
        self._busy[worker.render.remote(self._settings, mark, self._folder)] = (worker, mark)

    def _lost(self, mark: ChunkMark, error: RayError) -> None:
        if self._tries[mark] >= _MOST_TRIES:
            reason = str(error).splitlines()[0]
            raise NlensError(
                f"frames {mark.first} to {mark.end}: {_MOST_TRIES} workers were lost over them "
                f"({reason}); render that range alone with -v to see why"
            ) from error
        sweep(self._folder / mark.file_name)  # what it has left
        self._idle.append(_hired())


def _hired() -> Any:  # noqa: ANN401  # Ray's handles have no type of their own
    return ray.remote(num_cpus=_CPUS, max_restarts=0)(_Worker).remote()


@contextmanager
def _connected(cluster: Cluster) -> Iterator[int]:
    """How many workers there are to be."""
    workers = cluster.workers or max(1, (os.cpu_count() or 1) // _CPUS)
    local = cluster.address is None
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
        if cluster.address and cluster.workers is None:
            found: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
            workers = max(1, int(found.get("CPU", _CPUS)) // _CPUS)
        yield workers
    finally:
        ray.shutdown()
