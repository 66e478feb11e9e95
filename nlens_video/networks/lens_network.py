"""The lens network on ONNX Runtime; see `models/lens`."""

from __future__ import annotations

from pathlib import Path

from nlens_video.core.layers import Float32
from nlens_video.networks.onnx_networks import OnnxSession
from nlens_video.stages.whole_ground.network_reading import FEWEST
from nlens_video.stages.whole_ground.patches import Patches


class OnnxLensNetwork:
    """A `LensNetwork` from an ONNX file.

    Args:
        path: inputs `readings` (1, P, READINGS) and `places` (1, P, PLACE), output `lenses`
            (1, CANDIDATES, NUMBERS).

    Raises:
        NlensError: the file is no ONNX model, or one with other inputs and outputs.
    """

    def __init__(self, path: Path) -> None:
        self._session = OnnxSession(
            path, ["readings", "places"], ["lenses"], made_by="models/lens/export.py"
        )

    def __call__(self, patches: Patches) -> Float32:
        """Read one ground; see `LensNetwork`.

        Raises:
            ValueError: fewer than `FEWEST` patches.
        """
        if len(patches.places) < FEWEST:
            raise ValueError(f"{len(patches.places) = }, at least {FEWEST} are needed")
        return self._session.run(readings=patches.readings, places=patches.places)[0]
