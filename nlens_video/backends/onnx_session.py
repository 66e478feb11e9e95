"""Opens a network in ONNX Runtime, with repeatable results and quiet threads."""

from __future__ import annotations

from pathlib import Path

import onnxruntime

from nlens_video.errors import NlensError


def open_session(
    path: Path,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    *,
    threads: int,
    made_by: str,
    cuda: bool = False,
) -> onnxruntime.InferenceSession:
    """Load an ONNX file and see that it is the network that is meant.

    Args:
        path: the file.
        inputs: names of its inputs, in order.
        outputs: names of its outputs, in order.
        threads: threads that one call runs on.
        made_by: what writes such a file, for the error message.
        cuda: run it on CUDA, where this ONNX Runtime can; else on the CPU.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    # spinning threads would take the cores from decoding and rendering between two calls
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(
            str(path), options, providers=[*_cuda_provider(cuda=cuda), "CPUExecutionProvider"]
        )
    except Exception as error:  # the runtime's errors share no public base
        cause = str(error).splitlines()[0]
        raise NlensError(
            f"{path}: ONNX Runtime cannot load this network ({cause}); install the package anew"
        ) from error
    names = [node.name for node in (*session.get_inputs(), *session.get_outputs())]
    if names != [*inputs, *outputs]:
        raise NlensError(
            f"{path}: inputs and outputs {names}, expected {[*inputs, *outputs]}; "
            f"export it with {made_by}"
        )
    return session


def _cuda_provider(*, cuda: bool) -> list[str]:
    name = "CUDAExecutionProvider"
    return [name] if cuda and name in onnxruntime.get_available_providers() else []
