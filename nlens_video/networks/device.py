"""Choice of the device on which networks and kernels run."""

from __future__ import annotations

import ctypes
import importlib.util
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from nlens_video.core.errors import UsageError

if TYPE_CHECKING:
    from nlens_video.core.settings import Device
    from nlens_video.kernels.scatter.scatter import Spread


@dataclass(frozen=True, slots=True)
class DeviceChoice:
    """A device.

    Attributes:
        name: `cpu` or `cuda`.
        reason: why it was chosen.
        notes: events on it the user should know of, such as lack of memory.
    """

    name: str
    reason: str
    notes: list[str] = field(default_factory=list, compare=False)

    @property
    def spread(self) -> Spread | None:
        """The scatter's spreading on this device, None for the CPU's kernel."""
        if self.name == "cpu":
            return None
        from nlens_video.kernels.scatter.scatter_torch import TorchSpread

        return TorchSpread(self.name, self.notes)


CPU = DeviceChoice("cpu", "nothing else was asked for")


def choose(device: Device) -> DeviceChoice:
    """Choose where networks and kernels run.

    Args:
        device: `auto` is the CPU, which is faster (decision 074).

    Raises:
        UsageError: `cuda` is asked for and cannot be used.
    """
    if device == "auto":
        return DeviceChoice("cpu", "its kernels are faster than those for a GPU")
    if device == "cuda" and (missing := why_no_cuda()):
        raise UsageError(f"--device cuda: {missing}; use --device cpu")
    return DeviceChoice(device, "as asked for")


def why_no_cuda() -> str:
    """Why CUDA cannot be used, in a clause; empty where it can."""
    if importlib.util.find_spec("torch") is None:
        return "torch is not installed (pip install torch)"
    try:
        ctypes.CDLL("libcuda.so.1")  # first, since loading torch takes seconds
    except OSError:
        return "there is no NVIDIA driver"
    import torch

    if torch.version.cuda is None:
        return f"torch {torch.__version__} is built without CUDA"
    return "" if torch.cuda.is_available() else "torch finds no GPU"
