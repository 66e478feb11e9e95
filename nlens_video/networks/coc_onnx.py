"""The CoC network on ONNX Runtime, CPU."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np

from nlens_video.core.layers import CocMap, CocPrior, Float32
from nlens_video.networks.device import CPU, DeviceChoice
from nlens_video.networks.onnx_session import Session

THREADS = 2
INPUT, OUTPUTS = "rgb", ("coc_px", "sigma_px")
PRIOR = "log_coc_prior"
"""Key of the file's metadata: mean and deviation of log(1 + CoC) in training, a blank between."""


class OnnxCocNetwork:
    """A `CocNetwork` from an ONNX file; one session, freed by `close` or at the end of `with`.

    The same picture gives the same bits on the same machine for any number of calls. Not for use
    from several threads at once.

    Args:
        path: the ONNX file; input `rgb` (1, H, W, 3), outputs `coc_px`, `sigma_px` (1, h, w).
        threads: threads that one estimate runs on.
        device: where it runs; see `Session`.

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path, threads: int = THREADS, device: DeviceChoice = CPU) -> None:
        session = Session(
            path, (INPUT,), OUTPUTS, threads=threads, made_by="models/coc/export.py", device=device
        )
        self._session: Session | None = session
        self._prior = _prior(session)

    @property
    def stride(self) -> int:
        """Height and width of the input must be multiples of this [px]."""
        return 32

    def __call__(self, rgb: Float32) -> CocMap:
        """Estimate one picture (H, W, 3), display-coded; maps at a quarter of its size.

        Raises:
            ValueError: sides that are no multiples of `stride`, or a closed network.
        """
        if self._session is None:
            raise ValueError("the network is closed")
        if rgb.shape[0] % self.stride or rgb.shape[1] % self.stride:
            raise ValueError(f"{rgb.shape = } must be multiples of {self.stride}")
        batch = np.ascontiguousarray(rgb, dtype=np.float32)[None]
        coc, sigma = self._session.run({INPUT: batch})
        return CocMap(coc_px=coc[0], sigma_px=sigma[0], prior=self._prior)

    def close(self) -> None:
        """Free the session and its memory; a second call does nothing."""
        self._session = None

    def __enter__(self) -> OnnxCocNetwork:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _prior(session: Session) -> CocPrior | None:
    """Training prior from the file's metadata, None without it."""
    text = session.metadata.get(PRIOR)
    if text is None:
        return None
    mean, deviation = (float(word) for word in text.split())
    return CocPrior(mean=mean, deviation=deviation)
