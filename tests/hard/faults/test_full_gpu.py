"""A GPU without memory for a network: the CPU runs it, with a word.

No GPU is full here. In its place stands the processor with ONNX Runtime's own arena, which is that
of CUDA too, bounded to a megabyte: the error is the real one, at the real place.
"""

from functools import cache

import numpy as np
import onnxruntime
import pytest

from nlens_video.core.errors import NlensError
from nlens_video.networks import onnx_networks
from nlens_video.networks.device import DeviceChoice
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork, OnnxRepairNetwork
from nlens_video.stages.l_depth_order import CHANNELS

PICTURE = np.random.default_rng(0).random((512, 960, 3), np.float32)
Real = onnxruntime.InferenceSession


@cache
def _bound_the_arena():
    """For sessions that ask for the process' allocators, and for no other."""
    kind = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    place = onnxruntime.OrtMemoryInfo("Cpu", kind, 0, onnxruntime.OrtMemType.DEFAULT)
    bound = onnxruntime.OrtArenaCfg({"max_mem": 1 << 20, "arena_extend_strategy": 1})
    onnxruntime.create_and_register_allocator(place, bound)


class SmallGpu(Real):
    """What is meant for CUDA runs on the processor, in a megabyte."""

    asked = 0

    def __init__(self, path, options, providers, **more):
        if "CUDAExecutionProvider" in providers:
            SmallGpu.asked += 1
            _bound_the_arena()
            options.add_session_config_entry("session.use_env_allocators", "1")
            options.log_severity_level = 4
        super().__init__(path, options, providers=["CPUExecutionProvider"], **more)


@pytest.fixture
def small_gpu(monkeypatch):
    SmallGpu.asked = 0
    monkeypatch.setattr(onnx_networks.onnxruntime, "InferenceSession", SmallGpu)
    there = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnx_networks.onnxruntime, "get_available_providers", lambda: there)
    return DeviceChoice("cuda", "a test")


def test_gpu_out_of_memory_falls_back_to_the_cpu_with_one_note(small_gpu):
    with OnnxCocNetwork(find_model("coc").path) as network:
        expected = network(PICTURE)
    with OnnxCocNetwork(find_model("coc").path, device=small_gpu) as network:
        for _ in range(2):
            found = network(PICTURE)
            np.testing.assert_array_equal(found.coc_px, expected.coc_px)
            np.testing.assert_array_equal(found.sigma_px, expected.sigma_px)
            assert found.prior == expected.prior
    assert small_gpu.notes == [
        "the GPU cannot run the network coc.onnx (its memory does not suffice): the CPU does"
    ]
    assert SmallGpu.asked == 1


def test_network_that_fits_stays_on_the_gpu(small_gpu):
    network = OnnxRepairNetwork(find_model("reblur").path, device=small_gpu)
    network(np.zeros((8, 8, CHANNELS), np.float32))
    assert (SmallGpu.asked, small_gpu.notes) == (1, [])


def test_network_that_does_not_load_on_the_gpu_is_loaded_on_the_cpu(small_gpu, monkeypatch):
    class Full(SmallGpu):
        def __init__(self, path, options, providers, **more):
            if "CUDAExecutionProvider" in providers:
                raise onnx_networks.states.RuntimeException("CUDA failure 2: out of memory ; GPU=0")
            super().__init__(path, options, providers, **more)

    monkeypatch.setattr(onnx_networks.onnxruntime, "InferenceSession", Full)
    with OnnxCocNetwork(find_model("coc").path, device=small_gpu) as network:
        assert np.isfinite(network(PICTURE[:32, :32]).coc_px).all()
    assert len(small_gpu.notes) == 1 and "memory" in small_gpu.notes[0]


def test_damaged_network_on_the_gpu_is_refused_in_one_line(small_gpu, tmp_path):
    path = tmp_path / "broken.onnx"
    path.write_bytes(b"not a network")
    with pytest.raises(NlensError, match=r"broken\.onnx.*cannot load") as caught:
        OnnxCocNetwork(path, device=small_gpu)
    assert "\n" not in str(caught.value)


def test_other_gpu_failures_are_reported_with_their_message(small_gpu, monkeypatch):
    def fail(session, *given):
        if SmallGpu.asked and session.first:
            SmallGpu.first = False
            raise onnx_networks.states.EPFail("CUDA failure 719: unspecified launch failure")
        return Real.run(session, *given)

    monkeypatch.setattr(SmallGpu, "first", True, raising=False)
    monkeypatch.setattr(SmallGpu, "run", fail, raising=False)
    with OnnxCocNetwork(find_model("coc").path, device=small_gpu) as network:
        assert np.isfinite(network(PICTURE[:32, :32]).coc_px).all()
    assert "(CUDA failure 719: unspecified launch failure)" in small_gpu.notes[0]
