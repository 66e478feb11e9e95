"""Tables and networks made ready in the background while the source opens and the lens is fitted.

Nodes that need some fill or load them on a layer of a few pixels (`Node.warm_up`), on a thread; a
frame waits only for what it needs and what is not ready. Results do not depend on it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Self

import numpy as np

from nlens_video.core.box import Box
from nlens_video.core.layers import BlurredLayer, DefocusedLayer, HiddenLayer, ObjectLayer
from nlens_video.graph.base.node import Node

_SIDE = 24
FRAME = Box(0, 0, _SIDE, _SIDE)
"""Frame of the layers that nodes are warmed up with [px]."""


class WarmUp:
    """Warms nodes up on a thread, from `__enter__` on; `__exit__` ends it after the node at hand.

    Args:
        nodes: those that will run.
    """

    def __init__(self, nodes: Iterable[Node]) -> None:
        self._nodes = tuple(nodes)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="nlens-warm-up", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        for node in self._nodes:
            if self._stop.is_set():
                return
            try:
                node.warm_up()
            except Exception:  # noqa: BLE001  the frame that needs it says what is wrong
                return


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
