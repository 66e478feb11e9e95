"""Kernel warm-up in the background while the source opens and the lens is fitted.

numba compiles a kernel when it is first called, some ten seconds for all of them after an
installation, and reads it from its cache after that, a fraction of a second. Nodes call theirs on
layers of a few pixels (`Node.warm_up`), on a thread; a frame waits only for a kernel that it needs
and that is not ready. Results do not depend on it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from typing import Self

import numpy as np

from nlens_video.core.box import Box
from nlens_video.core.layers import BlurredLayer, DefocusedLayer, HiddenLayer, ObjectLayer
from nlens_video.graph.base.node import Node
from nlens_video.kernels import numba_config
from nlens_video.kernels.scatter.subaperture_gather import gather_subaperture
from nlens_video.video.pixels.picture import ArrayPicture

_NOTICEABLE_S = 2.0
_SIDE = 24
FRAME = Box(0, 0, _SIDE, _SIDE)
"""Frame of the layers that kernels are compiled with [px]."""


class KernelWarmup:
    """Warms nodes up on a thread, from `__enter__` on; `__exit__` ends it after the node at hand.

    Args:
        nodes: those that will run.
    """

    def __init__(self, nodes: Iterable[Node]) -> None:
        self._nodes = tuple(nodes)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nlens-warm-up", daemon=True)
        self._seconds = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know: where kernels are kept, that compiling took a while."""
        where = numba_config.cache_notes()
        if where or self._seconds < _NOTICEABLE_S:
            return where
        return (
            f"kernels were compiled or loaded in {self._seconds:.0f} s; they are kept, so the next "
            "run starts sooner",
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
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


def sharp_layer(*, hidden: bool = False) -> DefocusedLayer:
    """A layer with a CoC discontinuity, whose discs use every method of the scatter.

    Args:
        hidden: whether it holds hidden surfaces.
    """
    rgba = np.ones((_SIDE, _SIDE, 4), np.float32)
    coc = np.repeat(np.linspace(-44.0, 0.0, _SIDE, dtype=np.float32)[:, None], _SIDE, axis=1)
    coc[:, _SIDE // 2 :] = 3.0
    layer = ObjectLayer(box=FRAME, rgba=rgba, depth=np.ones_like(coc))
    behind = (
        HiddenLayer(box=FRAME, rgba=rgba, coc_px=coc - 5.0, front_rgba=rgba) if hidden else None
    )
    return DefocusedLayer(layer=layer, coc_px=coc, behind=behind)


def blurred_layer() -> BlurredLayer:
    """A blurred layer on the same frame."""
    return BlurredLayer(box=FRAME, rgba=sharp_layer().layer.rgba)


def cell() -> None:
    """The blur of small discs."""
    sharp = sharp_layer()
    rgba = sharp.layer.rgba
    gather_subaperture(rgba, rgba[..., 3] > 0.0, np.clip(sharp.coc_px, -4.0, 4.0), FRAME)


def blend() -> None:
    """Samples to scene-linear light and back."""
    picture = ArrayPicture(np.zeros((_SIDE, _SIDE, 3), np.uint8))
    picture.linear(FRAME)
    picture.composite_over(FRAME, sharp_layer().layer.rgba)
