"""The sun network on ONNX Runtime; see `models/sun`."""

from __future__ import annotations

from pathlib import Path

from nlens_video.core.layers import Float32
from nlens_video.networks.onnx_networks import OnnxSession
from nlens_video.scene.plate_sun import CHANNELS, MAP_COLUMNS, MAP_ROWS


class OnnxSunNetwork:
    """A `SunNetwork` from an ONNX file.

    Args:
        path: input `features` (1, MAP_ROWS, MAP_COLUMNS, CHANNELS), output `answer` (1, ANSWERS).

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path) -> None:
        self._session = OnnxSession(path, ["features"], ["answer"], made_by="models/sun/export.py")

    def __call__(self, features: Float32) -> Float32:
        """Read one plate; see `SunNetwork`.

        Raises:
            ValueError: features of another shape.
        """
        if features.shape != (MAP_ROWS, MAP_COLUMNS, CHANNELS):
            raise ValueError(f"{features.shape = }, expected {(MAP_ROWS, MAP_COLUMNS, CHANNELS)}")
        return self._session.run(features=features)[0]
