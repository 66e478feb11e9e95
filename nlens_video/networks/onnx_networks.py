"""The networks of F and of the reblur on ONNX Runtime.

The same input gives the same bits on the same machine for any number of calls. No network is for
use from several threads at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.layers import CocMap, CocPrior, Float32
from nlens_video.networks.device import CPU, DeviceChoice
from nlens_video.networks.onnx_session import Session
from nlens_video.stages.l_depth_order import CELL, CHANNELS

PRIOR = "log_coc_prior"
"""Key of the CoC network's metadata: mean and deviation of log(1 + CoC) in training, a blank
between."""

STRIP_ROWS = 256
"""Rows that the paper's networks take at a time: memory is bounded by the frame's width."""

HALO_ROWS = 20
"""Rows around a strip that its result depends on: eight convolutions at half the size, rounded."""


class OnnxCocNetwork(AbstractContextManager["OnnxCocNetwork"]):
    """A `CocNetwork` from an ONNX file; the session is freed by `close` or at the end of `with`.

    Args:
        path: input `rgb` (1, H, W, 3), outputs `coc_px`, `sigma_px` (1, h, w).
        device: where it runs; see `Session`.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    stride = 32
    """Height and width of the input must be multiples of this [px]."""

    def __init__(self, path: Path, device: DeviceChoice = CPU) -> None:
        self._session: Session | None = Session(
            path, ["rgb"], ["coc_px", "sigma_px"], made_by="models/coc/export.py", device=device
        )
        self._prior = _prior(self._session.metadata.get(PRIOR))

    def __call__(self, rgb: Float32) -> CocMap:
        """Estimate one picture (H, W, 3), display-coded; maps at a quarter of its size.

        Raises:
            ValueError: sides that are no multiples of `stride`, or a closed network.
        """
        if self._session is None:
            raise ValueError("the network is closed")
        if rgb.shape[0] % self.stride or rgb.shape[1] % self.stride:
            raise ValueError(f"{rgb.shape = } must be multiples of {self.stride}")
        coc, sigma = self._session.run(rgb=rgb)
        return CocMap(coc_px=coc, sigma_px=sigma, prior=self._prior)

    def close(self) -> None:
        """Free the session and its memory; a second call does nothing."""
        self._session = None

    def __exit__(self, *_: object) -> None:
        self.close()


def _prior(text: str | None) -> CocPrior | None:
    if text is None:
        return None
    mean, deviation = map(float, text.split())
    return CocPrior(mean=mean, deviation=deviation)


class OnnxRepairNetwork:
    """A `RepairNetwork` from an ONNX file.

    Args:
        path: input `geometry` (1, h, w, CHANNELS), output `judgement` (1, h, w, 2).
        device: where it runs; see `Session`.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path, device: DeviceChoice = CPU) -> None:
        self._session = Session(
            path, ["geometry"], ["judgement"], made_by="models/reblur/export.py", device=device
        )

    def __call__(self, geometry: Float32) -> Float32:
        """Judge one region (h, w, CHANNELS); see `RepairNetwork`.

        Raises:
            ValueError: sides that are no multiples of `CELL`, or other maps.
        """
        height, width, channels = geometry.shape
        if height % CELL or width % CELL or channels != CHANNELS:
            raise ValueError(f"{geometry.shape = } must be multiples of {CELL} by {CHANNELS} maps")
        return self._session.run(geometry=geometry)[0]


class OnnxPaperNetworks:
    """`PaperNetworks` from two ONNX files; see `models/paper`.

    Whole frames go through in strips that see all they depend on, so the strips leave no seam.

    Args:
        arnet: inputs `code` (1, H, W, 3), `defocus` (1, H, W, 1), output `rendered` (1, H, W, 4).
        iunet: the same and `coarse` (1, H / 2, W / 2, 3), output `refined` (1, H, W, 3).

    Raises:
        NlensError: a file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, arnet: Path, iunet: Path) -> None:
        made_by = "models/paper/export.py"
        self._arnet = Session(arnet, ["code", "defocus"], ["rendered"], made_by=made_by)
        self._iunet = Session(iunet, ["code", "defocus", "coarse"], ["refined"], made_by=made_by)

    def render(self, code: Float32, defocus: Float32) -> tuple[Float32, Float32]:
        """ARNet; see `PaperNetworks`."""
        height, width = defocus.shape
        code, defocus = _even(code), _even(defocus)
        out = np.empty((*defocus.shape, 4), dtype=np.float32)
        for taken, kept, target in _strips(defocus.shape[0]):
            made = self._arnet.run(code=code[taken], defocus=defocus[taken, :, None])
            out[target] = made[0][kept]
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
            made = self._iunet.run(
                code=code[taken],
                defocus=defocus[taken, :, None],
                coarse=coarse[taken.start // 2 : taken.stop // 2],
            )
            out[target] = made[0][kept]
        return out[:height, :width]


def _even(values: Float32) -> Float32:
    """The picture with a last row or column repeated where its sides are odd."""
    below, right = values.shape[0] % 2, values.shape[1] % 2
    pad = ((0, below), (0, right), *[(0, 0)] * (values.ndim - 2))
    return np.pad(values, pad, mode="edge")


def _strips(rows: int) -> Iterator[tuple[slice, slice, slice]]:
    """For each strip: rows to take, which of them to keep, and where they belong."""
    for top in range(0, rows, STRIP_ROWS):
        bottom = min(top + STRIP_ROWS, rows)
        first, last = max(0, top - HALO_ROWS), min(rows, bottom + HALO_ROWS)
        yield slice(first, last), slice(top - first, bottom - first), slice(top, bottom)
