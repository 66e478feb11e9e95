"""The scatter in torch, on the CPU and on a GPU, against the compiled kernel."""

import importlib.util

import numpy as np
import pytest

from nlens_video.core.errors import UsageError
from nlens_video.core.layers import Box
from nlens_video.core.optics import Aperture
from nlens_video.kernels.scatter.scatter import DRAFT, FINE, scatter
from nlens_video.kernels.scatter.scatter_ref import scatter_ref
from nlens_video.networks import device

APERTURES = {
    "round": Aperture(),
    "blades": Aperture(blades=5, rotation_deg=11.0),
    "cat's eye": Aperture(cat_eye=0.8),
}


on_each_device = pytest.mark.parametrize(
    "place", ["cpu", pytest.param("cuda", marks=pytest.mark.needs_cuda)]
)


def layer(least, largest, margin):
    rng = np.random.default_rng(0)
    rgba = np.zeros((30 + 2 * margin, 36 + 2 * margin, 4), np.float32)
    rgba[margin:-margin, margin:-margin] = rng.random((30, 36, 4))
    rows = np.linspace(least, largest, rgba.shape[0], dtype=np.float32)
    return rgba, np.repeat(rows[:, None], rgba.shape[1], axis=1)


def spread(place="cpu"):
    from nlens_video.kernels.scatter.scatter_torch import TorchSpread

    return TorchSpread(place)


@pytest.mark.slow
@pytest.mark.needs_torch
@on_each_device
@pytest.mark.parametrize(
    ("shape", "least", "largest", "detail"),
    [
        ("round", -3, 3, FINE),
        ("round", 20, 90, FINE),
        ("round", -14, 20, DRAFT),
        ("blades", -14, 20, FINE),
        ("cat's eye", 20, 60, FINE),
    ],
)
def test_torch_scatter_agrees_with_the_kernel(shape, least, largest, detail, place):
    rgba, coc = layer(least, largest, margin=50)
    frame = Box(-33, -20, 300, 250)
    given = {"aperture": APERTURES[shape], "frame": frame, "detail": detail, "pixel_aspect": 1.2}
    kernel = scatter(rgba, coc, **given)
    found = scatter(rgba, coc, spread=spread(place), **given)
    np.testing.assert_allclose(found, kernel, atol=2e-5)


@pytest.mark.slow
@pytest.mark.needs_torch
@on_each_device
def test_torch_scatter_is_as_close_to_the_reference_as_the_kernel(place):
    rgba, coc = layer(-8.0, 10.0, margin=12)
    truth = scatter_ref(rgba, coc)
    kernel = np.abs(scatter(rgba, coc) - truth).max()
    assert np.abs(scatter(rgba, coc, spread=spread(place)) - truth).max() < kernel + 2e-5


@pytest.mark.slow
@pytest.mark.needs_torch
def test_torch_scatter_supports_an_aperture_picture(tmp_path):
    import cv2

    assert cv2.imwrite(str(tmp_path / "a.png"), np.eye(9, dtype=np.uint8) * 255)
    rgba, coc = layer(-6.0, 9.0, margin=16)
    given = {"aperture": Aperture(image=tmp_path / "a.png")}
    kernel = scatter(rgba, coc, **given)
    np.testing.assert_allclose(scatter(rgba, coc, spread=spread(), **given), kernel, atol=2e-5)


def test_auto_device_is_the_cpu_and_states_why():
    assert device.choose("auto").name == "cpu" and "faster" in device.choose("auto").reason
    assert device.choose("auto").spread is None
    assert device.choose("cpu").reason == "as asked for"


def test_device_that_cannot_be_used_is_refused_with_the_reason(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="torch is not installed .*; use --device cpu"):
        device.choose("cuda")


@pytest.mark.needs_torch
def test_gpu_out_of_memory_falls_back_to_the_cpu_with_a_note(monkeypatch):
    """torch's own error is raised at the seam: no GPU is full here."""
    import torch

    from nlens_video.kernels.scatter.scatter_torch import TorchSpread

    def full(*given, **named):
        raise torch.OutOfMemoryError("CUDA out of memory")

    monkeypatch.setattr(torch, "zeros", full)
    rgba, coc = layer(-9, 14, 20)
    where = device.DeviceChoice("cuda", "a test")
    filled = TorchSpread("cpu", where.notes)
    for _ in range(2):
        np.testing.assert_array_equal(scatter(rgba, coc, spread=filled), scatter(rgba, coc))
    assert where.notes == ["the GPU's memory does not suffice: the CPU blurs what it cannot"]
