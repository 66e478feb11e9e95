"""Kernel warm-up in the background while the source opens and the lens is fitted.

numba compiles a kernel when it is first called, some ten seconds for all of them after an
installation, and reads it from its cache after that, a fraction of one. Nodes say what that is
(`Node.warm_up`); it happens here, on a thread of its own, with inputs of a few pixels, and frames
wait for no more than what is not ready when they need it. What is computed does not depend on it.
"""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

from nlens_video.graph.builder import Graph
from nlens_video.kernels import numba_config

_WORTH_SAYING_S = 2.0


class KernelWarmup:
    """Warms graphs up from `__enter__` on; `__exit__` ends it after the node at hand.

    Args:
        graphs: what will run.
    """

    def __init__(self, *graphs: Graph) -> None:
        self._nodes = list({id(node): node for graph in graphs for node in graph.nodes}.values())
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nlens-warm-up", daemon=True)
        self._seconds = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know: where kernels are kept, that compiling took a while."""
        where = numba_config.cache_notes()
        if where or self._seconds < _WORTH_SAYING_S:
            return where
        return (
            f"kernels were compiled or loaded in {self._seconds:.0f} s; they are kept, so the next "
            "run starts sooner",
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        start = time.perf_counter()
        for node in self._nodes:
            if self._stop.is_set():
                return
            try:
                node.warm_up()
            except Exception:  # noqa: BLE001  the frame that needs it says what is wrong
                return
            self._seconds = time.perf_counter() - start
