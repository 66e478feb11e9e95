"""F on a run's first frame, begun while the rest of the run is prepared."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from nlens_video.core.layers import CocMap, Picture
from nlens_video.graph.base.context import CocEstimator


def begun_coc(estimate: CocEstimator, pictures: Sequence[Picture]) -> CocEstimator:
    """F, which reads some pictures from now on, on a thread of its own; of all others as asked.

    Args:
        estimate: F.
        pictures: what it will most likely be asked first: the picture whose CoC is estimated, and
            those that follow it. Nobody writes to them before that.

    Returns:
        The same estimates.
    """
    beside = ThreadPoolExecutor(1, "nlens-coc")  # whose thread Python waits for at its end
    begun = [(tuple(pictures), beside.submit(estimate, pictures[0], pictures[1:]))]
    beside.shutdown(wait=False)

    def estimated(picture: Picture, following: Sequence[Picture]) -> CocMap:
        asked = (picture, *following)
        for read, found in begun:
            begun.clear()  # the pictures are not needed a second time
            coc = found.result()
            if len(asked) == len(read) and all(map(operator.is_, asked, read)):
                return coc
        return estimate(picture, following)

    return estimated
