"""Write the trained repair network as ONNX, any region size, with its entry in the manifest.

    python -m models.reblur.export --checkpoint /tmp/reblur_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/reblur/weights.pt`. Weights are stored in half precision and widened on loading.
"""

from __future__ import annotations

from pathlib import Path

from torch import Tensor, nn

from models.exporting import load_into, run_export, write_onnx
from models.reblur.network import RepairNet
from nlens_video.stages.l_depth_order import CELL, CHANNELS

HERE = Path(__file__).parent


class Shipped(nn.Module):
    """The shipped interface: geometry (1, H, W, CHANNELS) to judgement (1, H, W, 2)."""

    def __init__(self, network: RepairNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, geometry: Tensor) -> Tensor:
        """Judge a region."""
        judgement: Tensor = self.network(geometry.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        return judgement


def load_network(path: Path) -> RepairNet:
    """The network with the averaged weights of a checkpoint, or with shipped ones."""
    return load_into(RepairNet(), path)


def export(network: RepairNet, path: Path) -> None:
    """Write the ONNX file."""
    write_onnx(
        Shipped(network), path, {"geometry": (1, 16 * CELL, 24 * CELL, CHANNELS)}, ("judgement",),
        {name: {1: "H", 2: "W"} for name in ("geometry", "judgement")},
        note="Repairs a scattered layer at depth steps; see the model card beside it",
    )  # fmt: skip


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    seen = f"(1, H, W, {CHANNELS}) float32, see Candidates; H, W multiples of {CELL}"
    answer = (
        "(1, H, W, 2) float32: share of the ordered layers in [0, 1], relative change of the "
        "near coverage in [-0.5, 0.5]"
    )
    run_export(
        __doc__, load_network, export, HERE / "reblur.onnx",
        {"geometry": seen}, {"judgement": answer},
    )  # fmt: skip


if __name__ == "__main__":
    main()
