"""F on a run's first frame, begun while the rest of the run is prepared."""

from __future__ import annotations

import operator
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from nlens_video.core.layers import CocMap, Picture
from nlens_video.graph.base.context import CocEstimator
from nlens_video.graph.base.profiler import Profiler


class BegunCoc:
    """F as it is given, which may begin with some pictures before it is asked.

    Args:
        estimate: F.
        profiler: gets the time of what was begun, beyond that for which it was waited.
    """

    def __init__(self, estimate: CocEstimator, profiler: Profiler) -> None:
        self._estimate = estimate
        self._profiler = profiler
        self._begun: tuple[tuple[Picture, ...], Future[tuple[CocMap, float]]] | None = None

    def begin(self, pictures: Sequence[Picture]) -> None:
        """Read some pictures from now on, on a thread of its own.

        Args:
            pictures: those of the run's first frames: the one whose CoC is estimated, and those
                that follow it. Nobody writes to them before that.
        """
        beside = ThreadPoolExecutor(1, "nlens-coc")  # whose thread Python waits for at its end
        self._begun = (tuple(pictures), beside.submit(self._timed, pictures))
        beside.shutdown(wait=False)

    def forget(self) -> None:
        """Drop what was begun: nobody will ask."""
        self._begun = None

    def __call__(self, picture: Picture, following: Sequence[Picture]) -> CocMap:
        """As F."""
        begun, self._begun = self._begun, None  # the pictures are not needed a second time
        if begun is not None:
            pictures, found = begun
            asked = (picture, *following)
            start = time.perf_counter()
            coc, elapsed_ms = found.result()
            waited_ms = 1e3 * (time.perf_counter() - start)
            if len(asked) == len(pictures) and all(map(operator.is_, asked, pictures)):
                self._profiler.add(0, "estimate-coc", max(0.0, elapsed_ms - waited_ms))
                return coc
        return self._estimate(picture, following)

    def _timed(self, pictures: Sequence[Picture]) -> tuple[CocMap, float]:
        start = time.perf_counter()
        coc = self._estimate(pictures[0], pictures[1:])
        return coc, 1e3 * (time.perf_counter() - start)
