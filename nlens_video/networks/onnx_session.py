"""ONNX Runtime session with deterministic results, idle threads and fallback from GPU to CPU."""

from __future__ import annotations

import os
from pathlib import Path

# Official builds (1.29 and later) send telemetry and store a device id in the home folder, unless
# this is set before they are loaded.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import numpy as np
import onnxruntime
from onnxruntime.capi import onnxruntime_pybind11_state as states

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import Float32
from nlens_video.networks.device import CPU, DeviceChoice

onnxruntime.disable_telemetry_events()  # the same on Windows
_GPU_FAILED = (
    states.RuntimeException, states.Fail, states.EPFail, states.EngineError, states.DeviceReset
)  # fmt: skip
"""Errors of a provider's failed allocation or kernel; the runtime's errors share no base."""
THREADS = 2
"""Threads that one call runs on."""


class Session:
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
