"""The camera network on ONNX Runtime; see `models/camera`."""

from __future__ import annotations

from pathlib import Path

from nlens_video.core.layers import Float32
from nlens_video.networks.onnx_networks import OnnxSession
from nlens_video.solve.still.picture_cue import CHANNELS, COLUMNS, ROWS


class OnnxCameraNetwork:
    """A `CameraNetwork` from an ONNX file.

    Args:
        path: inputs `features` (1, ROWS, COLUMNS, CHANNELS) and `aspect` (1, 1), output `answer`
            (1, ANSWERS).

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path) -> None:
        self._session = OnnxSession(
            path, ["features", "aspect"], ["answer"], made_by="models/camera/export.py"
        )

    def __call__(self, features: Float32, aspect: Float32) -> Float32:
        """Read one picture; see `CameraNetwork`.

        Raises:
            ValueError: features of another shape.
        """
        if features.shape != (ROWS, COLUMNS, CHANNELS):
            raise ValueError(f"{features.shape = }, expected {(ROWS, COLUMNS, CHANNELS)}")
        return self._session.run(features=features, aspect=aspect)[0]
