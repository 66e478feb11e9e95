"""Write the trained sun network as ONNX, with its entry in the manifest.

    python -m models.sun.export --checkpoint /tmp/sun_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/sun/weights.pt`. Weights are stored in half precision and widened on loading.
"""

from __future__ import annotations

from pathlib import Path

from models.exporting import load_into, run_export, write_onnx
from models.sun.network import SunNet
from nlens_video.scene.plate_sun import ANSWERS, CHANNELS, MAP_COLUMNS, MAP_ROWS

HERE = Path(__file__).parent


def load_network(path: Path) -> SunNet:
    """The network with the averaged weights of a checkpoint, or with shipped ones."""
    return load_into(SunNet(), path)


def export(network: SunNet, path: Path) -> None:
    """Write the ONNX file."""
    write_onnx(
        network, path, {"features": (1, MAP_ROWS, MAP_COLUMNS, CHANNELS)}, ("answer",), {},
        note="Where the sun stands, by what a plate shows; nlens-video.",
    )  # fmt: skip


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    run_export(
        __doc__, load_network, export, HERE / "sun.onnx",
        {"features": f"(1, {MAP_ROWS}, {MAP_COLUMNS}, {CHANNELS}) float32, see sun_features"},
        {"answer": f"(1, {ANSWERS}) float32, see ANSWERS"},
    )  # fmt: skip


if __name__ == "__main__":
    main()
