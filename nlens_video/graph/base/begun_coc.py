"""F on a run's first frame, begun while the rest of the run is prepared."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from nlens_video.core.layers import CocMap, Picture
from nlens_video.graph.base.context import CocEstimator


class BegunCoc:
    """F as it is given, which may begin with some pictures before it is asked.

    Args:
        estimate: F.
    """

    def __init__(self, estimate: CocEstimator) -> None:
        self._estimate = estimate
        self._begun: tuple[tuple[Picture, ...], Future[CocMap]] | None = None

    def begin(self, pictures: Sequence[Picture]) -> None:
        """Read some pictures from now on, on a thread of its own.

        Args:
            pictures: what it will most likely be asked first: the picture whose CoC is estimated,
                and those that follow it. Nobody writes to them before that.
        """
        beside = ThreadPoolExecutor(1, "nlens-coc")  # whose thread Python waits for at its end
        found = beside.submit(self._estimate, pictures[0], pictures[1:])
        self._begun = (tuple(pictures), found)
        beside.shutdown(wait=False)

    def __call__(self, picture: Picture, following: Sequence[Picture]) -> CocMap:
        """As F."""
        begun, self._begun = self._begun, None  # the pictures are not needed a second time
        if begun is not None:
            pictures, found = begun
            asked = (picture, *following)
            coc = found.result()
            if len(asked) == len(pictures) and all(map(operator.is_, asked, pictures)):
                return coc
        return self._estimate(picture, following)
