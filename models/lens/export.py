"""Write the trained lens network as ONNX, with its entry in the manifest.

    python -m models.lens.export --checkpoint /tmp/lens_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/lens/weights.pt`. Weights are stored in half precision and widened on loading.
"""

from __future__ import annotations

from pathlib import Path

from torch import Tensor, nn

from models.exporting import load_into, run_export, write_onnx
from models.lens.network import LensNet, told
from nlens_video.stages.whole_ground.network_reading import CANDIDATES, FEWEST, NUMBERS
from nlens_video.stages.whole_ground.patches import PLACE, READINGS

HERE = Path(__file__).parent


class Shipped(nn.Module):
    """The shipped interface: readings and places of patches to lenses in plain numbers."""

    def __init__(self, network: LensNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, readings: Tensor, places: Tensor) -> Tensor:
        """Lenses (1, CANDIDATES, NUMBERS) of patches (1, P, …)."""
        return told(self.network(readings, places))


def load_network(path: Path) -> LensNet:
    """The network with the averaged weights of a checkpoint, or with shipped ones."""
    return load_into(LensNet(), path)


def export(network: LensNet, path: Path) -> None:
    """Write the ONNX file."""
    write_onnx(
        Shipped(network), path,
        {"readings": (1, FEWEST, READINGS), "places": (1, FEWEST, PLACE)}, ("lenses",),
        {"readings": {1: "P"}, "places": {1: "P"}},
        note="The lens of a ground; see the model card beside this file",
    )  # fmt: skip


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    run_export(
        __doc__, load_network, export, HERE / "lens.onnx",
        {
            "readings": f"(1, P, {READINGS}) float32, see Patches",
            "places": f"(1, P, {PLACE}) float32, see places",
        },
        {"lenses": f"(1, {CANDIDATES}, {NUMBERS}) float32, see LensNetwork"},
    )  # fmt: skip


if __name__ == "__main__":
    main()
