"""Write the trained camera network as ONNX, with its entry in the manifest.

    python -m models.camera.export --checkpoint /tmp/camera_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/camera/weights.pt`. Weights are stored in half precision and widened on loading.
"""

from __future__ import annotations

from pathlib import Path

from models.camera.network import CameraNet
from models.exporting import load_into, run_export, write_onnx
from nlens_video.solve.still.picture_cue import ANSWERS, CHANNELS, COLUMNS, ROWS

HERE = Path(__file__).parent


def load_network(path: Path) -> CameraNet:
    """The network with the averaged weights of a checkpoint, or with shipped ones."""
    return load_into(CameraNet(), path)


def export(network: CameraNet, path: Path) -> None:
    """Write the ONNX file."""
    write_onnx(
        network, path, {"features": (1, ROWS, COLUMNS, CHANNELS), "aspect": (1, 1)}, ("answer",),
        {}, note="Pitch, roll and focal length by what a picture looks like; nlens-video.",
    )  # fmt: skip


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    run_export(
        __doc__, load_network, export, HERE / "camera.onnx",
        {
            "features": f"(1, {ROWS}, {COLUMNS}, {CHANNELS}) float32, see picture_features",
            "aspect": "(1, 1) float32, logarithm of width by height",
        },
        {"answer": f"(1, {ANSWERS}) float32, see ANSWERS"},
    )  # fmt: skip


if __name__ == "__main__":
    main()
