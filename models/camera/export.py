"""Write the trained camera network as ONNX, with its entry in the manifest.

    python -m models.camera.export --checkpoint /tmp/camera_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/camera/weights.pt`. Weights are stored in half precision and widened on loading.
"""

from __future__ import annotations

from pathlib import Path

from models.camera.network import CameraNet
from models.exporting import arguments, load_into, update_manifest, write_onnx, write_weights
from nlens_video.solve.still.picture_cue import ANSWERS, CHANNELS, COLUMNS, ROWS

HERE = Path(__file__).parent


def load_network(path: Path) -> CameraNet:
    """The network with the averaged weights of a checkpoint, or with shipped ones."""
    network = CameraNet()
    load_into(network, path)
    return network


def export(network: CameraNet, path: Path) -> None:
    """Write the ONNX file."""
    write_onnx(
        network, path, {"features": (1, ROWS, COLUMNS, CHANNELS), "aspect": (1, 1)}, ("answer",),
        {}, note="Pitch, roll and focal length by what a picture looks like; nlens-video.",
    )  # fmt: skip


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    options = arguments(__doc__, HERE / "camera.onnx")
    network = load_network(options.checkpoint)
    export(network, options.out)
    if options.out.parent == HERE:
        write_weights(network, HERE)
        update_manifest(
            "camera", options.out,
            {
                "features": f"(1, {ROWS}, {COLUMNS}, {CHANNELS}) float32, see picture_features",
                "aspect": "(1, 1) float32, logarithm of width by height",
            },
            {"answer": f"(1, {ANSWERS}) float32, see ANSWERS"},
        )  # fmt: skip
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
