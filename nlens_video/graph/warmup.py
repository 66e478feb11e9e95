"""Kernels compiled, and networks loaded, while the source opens and the lens is looked for.

numba compiles a kernel when it is first called, some ten seconds for all of them after an
installation, and reads it from its cache after that, a fraction of one. Both happen here, on a
thread of their own, with inputs of a few pixels; frames wait for no more than what is not ready
when they need it. What is computed does not depend on any of it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Self

import numpy as np

from nlens_video.core.layers import (
    Behind,
    BlurredLayer,
    Box,
    DefocusedLayer,
    ObjectLayer,
)
from nlens_video.graph.builder import Graph
from nlens_video.graph.node import Node
from nlens_video.kernels import cache_folder

_SIDE = 24  # of what is computed [px]
_FRAME = Box(0, 0, _SIDE, _SIDE)
_WORTH_SAYING_S = 2.0

Work = Callable[[], object]


class Ahead:
    """Makes graphs' kernels ready from `__enter__` on; `__exit__` ends it after the one at hand.

    Args:
        graphs: what will run.
    """

    def __init__(self, *graphs: Graph) -> None:
        nodes = {id(node): node for graph in graphs for node in graph.nodes}
        self._work = _works(tuple(nodes.values()))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nlens-ahead", daemon=True)
        self._seconds = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know: where kernels are kept, that compiling took a while."""
        where = cache_folder.notes()
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
        for work in self._work:
            if self._stop.is_set():
                return
            try:
                work()
            except Exception:  # noqa: BLE001  the frame that needs it says what is wrong
                return
            self._seconds = time.perf_counter() - start


def _works(nodes: Sequence[Node]) -> list[Work]:
    """What to call for the nodes, in their order, each once."""
    works: dict[str, Work] = {}
    for node in nodes:
        if node.backend.startswith("software rasteriser"):
            works["render"] = _render
        if node.stage in ("scatter", "lens", "expose"):
            works["scatter"] = _scatter
        if node.stage in ("lens", "views"):
            works["cell"] = _cell
        if node.stage == "scatter":  # its own aperture's tables too
            works[node.backend] = partial(node.run, _sharp(), _FRAME)
        if node.stage == "repair":
            known = any(other.stage == "peel" for other in nodes)
            works[node.name] = partial(node.run, _sharp(behind=known), _blurred())
        if node.stage in ("composite", "darken"):
            works["blend"] = _blend
    return list(works.values())


def _sharp(*, behind: bool = False) -> DefocusedLayer:
    """A layer with a step of depth, whose discs take every kind of drawing.

    Args:
        behind: whether it is known what it hides.
    """
    rgba = np.ones((_SIDE, _SIDE, 4), np.float32)
    coc = np.repeat(np.linspace(-44.0, 0.0, _SIDE, dtype=np.float32)[:, None], _SIDE, axis=1)
    coc[:, _SIDE // 2 :] = 3.0
    layer = ObjectLayer(box=_FRAME, rgba=rgba, depth=np.ones_like(coc))
    hidden = Behind(box=_FRAME, rgba=rgba, coc_px=coc - 5.0, front_rgba=rgba) if behind else None
    return DefocusedLayer(layer=layer, coc_px=coc, behind=hidden)


def _blurred() -> BlurredLayer:
    return BlurredLayer(box=_FRAME, rgba=_sharp().layer.rgba)


def _render() -> None:
    from nlens_video.render.software.renderer import make_ready

    make_ready()


def _scatter() -> None:
    from nlens_video.kernels.scatter.scatter import scatter

    sharp = _sharp()
    scatter(sharp.layer.rgba, sharp.coc_px)


def _cell() -> None:
    from nlens_video.kernels.reblur.cell_gather import blur_cell

    sharp = _sharp()
    rgba = sharp.layer.rgba
    blur_cell(rgba, rgba[..., 3] > 0.0, np.clip(sharp.coc_px, -4.0, 4.0), _FRAME)


def _blend() -> None:
    from nlens_video.video.pixels.picture import ArrayPicture

    picture = ArrayPicture(np.zeros((_SIDE, _SIDE, 3), np.uint8))
    picture.linear(_FRAME)
    picture.over(_FRAME, _sharp().layer.rgba)
