"""The paper's two reblur networks on ONNX Runtime, CPU."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.networks.onnx_session import Session

THREADS = 2
STRIP_ROWS = 256
"""Rows that the networks take at a time, so that memory is bounded by the frame's width."""

HALO_ROWS = 20
"""Rows around a strip that its result depends on: eight convolutions at half the size, rounded."""

_MADE_BY = "models/paper/export.py"


class OnnxPaperNetworks:
    """`PaperNetworks` from two ONNX files; see `models/paper`.

    Whole frames go through in strips that see all they depend on, so the strips leave no seam. Not
    for use from several threads at once.

    Args:
        arnet: inputs `code` (1, H, W, 3), `defocus` (1, H, W, 1), output `rendered` (1, H, W, 4).
        iunet: the same and `coarse` (1, H / 2, W / 2, 3), output `refined` (1, H, W, 3).
        threads: threads that one call runs on.

    Raises:
        NlensError: a file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, arnet: Path, iunet: Path, threads: int = THREADS) -> None:
        self._arnet = Session(
            arnet, ("code", "defocus"), ("rendered",), threads=threads, made_by=_MADE_BY
        )
        self._iunet = Session(
            iunet, ("code", "defocus", "coarse"), ("refined",), threads=threads, made_by=_MADE_BY
        )

    def render(self, code: Float32, defocus: Float32) -> tuple[Float32, Float32]:
        """ARNet; see `PaperNetworks`."""
        height, width = defocus.shape
        code, defocus = _even(code), _even(defocus)
        out = np.empty((*defocus.shape, 4), dtype=np.float32)
        for taken, kept, target in _strips(defocus.shape[0]):
            feed = {"code": code[None, taken], "defocus": defocus[None, taken, :, None]}
            out[target] = self._arnet.run(feed)[0][0, kept]
        return out[:height, :width, :3], out[:height, :width, 3]

    def refine(self, code: Float32, defocus: Float32, coarse: Float32) -> Float32:
        """IUNet; see `PaperNetworks`."""
        height, width = defocus.shape
        code, defocus = _even(code), _even(defocus)
        half = (defocus.shape[0] // 2, defocus.shape[1] // 2)
        if coarse.shape[:2] != half:
            smaller = cv2.resize(coarse, half[::-1], interpolation=cv2.INTER_AREA)
            coarse = np.asarray(smaller, dtype=np.float32)
        out = np.empty(code.shape, dtype=np.float32)
        for taken, kept, target in _strips(defocus.shape[0]):
            feed = {
                "code": code[None, taken],
                "defocus": defocus[None, taken, :, None],
                "coarse": coarse[None, taken.start // 2 : taken.stop // 2],
            }
            out[target] = self._iunet.run(feed)[0][0, kept]
        return out[:height, :width]


def _even(values: Float32) -> Float32:
    """The picture with a last row or column repeated where its sides are odd."""
    below, right = values.shape[0] % 2, values.shape[1] % 2
    pad = ((0, below), (0, right), *[(0, 0)] * (values.ndim - 2))
    return np.ascontiguousarray(np.pad(values, pad, mode="edge"), dtype=np.float32)


def _strips(rows: int) -> Iterator[tuple[slice, slice, slice]]:
    """For each strip: rows to take, which of them to keep, and where they belong."""
    for top in range(0, rows, STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, rows)
        first, last = max(0, top - HALO_ROWS), min(rows, bottom + HALO_ROWS)
        yield slice(first, last), slice(top - first, bottom - first), slice(top, bottom)
