"""The networks of F and of the reblur on ONNX Runtime.

The same input gives the same bits on the same machine for any number of calls. Threads are idle
between calls. No network is for use from several threads at once.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

# Official builds (1.29 and later) send telemetry and store a device id in the home folder, unless
# this is set before they are loaded.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import cv2
import numpy as np
import onnxruntime
from onnxruntime.capi import onnxruntime_pybind11_state as states

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import CocMap, CocPrior, Float32
from nlens_video.networks.device import CPU, DeviceChoice
from nlens_video.stages.l_depth_order import CELL, CHANNELS

onnxruntime.disable_telemetry_events()  # the same on Windows
_GPU_FAILED = (
    states.RuntimeException, states.Fail, states.EPFail, states.EngineError, states.DeviceReset
)  # fmt: skip
"""Errors of a provider's failed allocation or kernel; the runtime's errors share no base."""
THREADS = 2
"""Threads that one call runs on."""

_LEAST_JUDGEMENT, _GREATEST_JUDGEMENT = np.array([[0.0, -0.5], [1.0, 0.5]], np.float32)
"""Limits of what the repair network answers: a share, and a change of coverage [1]."""

PRIOR = "log_coc_prior"
"""Key of the CoC network's metadata: mean and deviation of log(1 + CoC) in training, a blank
between."""

STRIP_ROWS = 256
"""Rows that the paper's networks take at a time: memory is bounded by the frame's width."""

HALO_ROWS = 20
"""Rows around a strip that its result depends on: eight convolutions at half the size, rounded."""


class OnnxSession:
    """A session of one ONNX file, whose inputs and outputs are checked.

    If the GPU fails, as a rule for lack of memory, the CPU runs the network from then on.

    Args:
        path: the file.
        inputs: names of its inputs, in order.
        outputs: names of its outputs, in order.
        made_by: the script that exports such a file, for the error message.
        device: where it runs: on CUDA only where this ONNX Runtime can. A failure of the GPU is
            added to its notes.

    Attributes:
        metadata: of the file, by key.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(
        self,
        path: Path,
        inputs: list[str],
        outputs: list[str],
        *,
        made_by: str,
        device: DeviceChoice = CPU,
    ) -> None:
        self._path = path
        self._outputs = outputs
        self._device = device
        self._on_gpu = (
            device.name == "cuda"
            and "CUDAExecutionProvider" in onnxruntime.get_available_providers()
        )
        self._session = self._opened()
        names = [node.name for node in (*self._session.get_inputs(), *self._session.get_outputs())]
        expected = [*inputs, *outputs]
        if names != expected:
            raise NlensError(
                f"{path}: inputs and outputs {names}, expected {expected}; export it with {made_by}"
            )
        self.metadata: dict[str, str] = self._session.get_modelmeta().custom_metadata_map

    def run(self, **inputs: Float32) -> list[Float32]:
        """The outputs, in order, for inputs by name; all without their batch axis."""
        batch = {
            name: np.ascontiguousarray(values, dtype=np.float32)[None]
            for name, values in inputs.items()
        }
        try:
            made = self._session.run(self._outputs, batch)
        except _GPU_FAILED as error:
            if not self._on_gpu:
                raise
            self._leave_gpu(error)
            self._session = self._opened()
            made = self._session.run(self._outputs, batch)
        return [values[0] for values in made]

    def _opened(self) -> onnxruntime.InferenceSession:
        gpu = ("CUDAExecutionProvider",) if self._on_gpu else ()
        try:
            return self._load(*gpu, "CPUExecutionProvider")
        except Exception as error:  # the runtime's errors share no public base
            if not self._on_gpu:
                cause = str(error).splitlines()[0]
                raise NlensError(
                    f"{self._path}: ONNX Runtime cannot load this network ({cause}); "
                    "install the package anew"
                ) from error
            self._leave_gpu(error)
        return self._opened()

    def _load(self, *providers: str) -> onnxruntime.InferenceSession:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = THREADS
        options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        # spinning threads would take the cores from decoding and rendering between two calls
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.enable_cpu_mem_arena = False
        options.log_severity_level = 3
        # its own way to the CPU prints on standard output, which may be the picture
        return onnxruntime.InferenceSession(
            str(self._path), options, providers=list(providers), enable_fallback=0
        )

    def _leave_gpu(self, error: Exception) -> None:
        said = " ".join(str(error).split())
        for_memory = "alloc" in said.lower() or "out of memory" in said.lower()
        why = "its memory does not suffice" if for_memory else said[-200:]
        self._on_gpu = False
        self._device.notes.append(
            f"the GPU cannot run the network {self._path.name} ({why}): the CPU does"
        )


class OnnxCocNetwork(AbstractContextManager["OnnxCocNetwork"]):
    """A `CocNetwork` from an ONNX file; the session is freed by `close` or at the end of `with`.

    Args:
        path: input `rgb` (1, H, W, 3), outputs `coc_px`, `sigma_px` (1, h, w).
        device: where it runs; see `OnnxSession`.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    stride = 32
    """Height and width of the input must be multiples of this [px]."""

    def __init__(self, path: Path, device: DeviceChoice = CPU) -> None:
        self._session: OnnxSession | None = OnnxSession(
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
        device: where it runs; see `OnnxSession`.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path, device: DeviceChoice = CPU) -> None:
        self._session = OnnxSession(
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
        judgement = self._session.run(geometry=geometry)[0]
        # on processors without AVX-512 a sigmoid may exceed its limits by its rounding
        return np.clip(judgement, _LEAST_JUDGEMENT, _GREATEST_JUDGEMENT)


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
        self._arnet = OnnxSession(arnet, ["code", "defocus"], ["rendered"], made_by=made_by)
        self._iunet = OnnxSession(
            iunet, ["code", "defocus", "coarse"], ["refined"], made_by=made_by
        )

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
