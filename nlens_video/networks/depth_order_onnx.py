"""The reblur's networks on ONNX Runtime, CPU."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.networks.device import CPU, DeviceChoice
from nlens_video.networks.onnx_session import Session
from nlens_video.stages.reblur.depth_order import CHANNELS
from nlens_video.stages.reblur.depth_order_repair import CELL

THREADS = 2
INPUT, OUTPUT = "geometry", "judgement"


class OnnxRepairNetwork:
    """A `RepairNetwork` from an ONNX file.

    The same maps give the same bits on the same machine for any number of calls. Not for use from
    several threads at once.

    Args:
        path: the ONNX file; input `geometry` (1, h, w, CHANNELS), output `judgement` (1, h, w, 2).
        threads: threads that one call runs on.
        device: where it runs; see `Session`.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path, threads: int = THREADS, device: DeviceChoice = CPU) -> None:
        self._session = Session(
            path,
            (INPUT,),
            (OUTPUT,),
            threads=threads,
            made_by="models/reblur/export.py",
            device=device,
        )

    def __call__(self, geometry: Float32) -> Float32:
        """Judge one region (h, w, CHANNELS); see `RepairNetwork`.

        Raises:
            ValueError: sides that are no multiples of `CELL`, or other maps.
        """
        height, width, channels = geometry.shape
        if height % CELL or width % CELL or channels != CHANNELS:
            raise ValueError(f"{geometry.shape = } must be multiples of {CELL} by {CHANNELS} maps")
        batch = np.ascontiguousarray(geometry, dtype=np.float32)[None]
        (judgement,) = self._session.run({INPUT: batch})
        return np.asarray(judgement[0], dtype=np.float32)
