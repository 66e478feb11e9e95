"""Write the trained repair network as ONNX, any region size, with its entry in the manifest.

    python -m models.reblur.export --checkpoint /tmp/reblur_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/reblur/weights.pt`. Weights are stored in half precision and widened on loading.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import onnx
import torch
from torch import Tensor, nn

from models.coc.export import with_half_weights
from models.manifest import sha256_of, write_entry
from models.reblur.network import RepairNet
from nlens_video.stages.reblur.depth_order import CHANNELS
from nlens_video.stages.reblur.depth_order_repair import CELL

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
    state = torch.load(path, weights_only=True)
    state = state.get("average", state)
    network = RepairNet().eval()
    network.load_state_dict({name: value.float() for name, value in state.items()})
    return network


def export(network: RepairNet, path: Path) -> None:
    """Write the ONNX file."""
    buffer = io.BytesIO()
    torch.onnx.export(
        Shipped(network).eval(),
        (torch.rand(1, 16 * CELL, 24 * CELL, CHANNELS),),
        buffer,
        input_names=["geometry"],
        output_names=["judgement"],
        dynamic_axes={"geometry": {1: "H", 2: "W"}, "judgement": {1: "H", 2: "W"}},
        opset_version=18,
        dynamo=False,  # much faster than the new exporter, and the same graph here
    )
    model = with_half_weights(onnx.load_from_string(buffer.getvalue()))
    for node in model.graph.node:  # names of source files
        node.doc_string = ""
    model.doc_string = "Repairs a scattered layer at depth steps; see the model card beside it"
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def entry(weights: Path) -> str:
    """The manifest's entry."""
    return (
        "[model.reblur]\n"
        f'file = "{weights.parent.name}/{weights.name}"\n'
        f'sha256 = "{sha256_of(weights)}"\n'
        'licence = "Apache-2.0"\n'
        'card = "reblur/README.md"\n\n'
        "[model.reblur.inputs]\n"
        f'geometry = "(1, H, W, {CHANNELS}) float32, see Candidates; H, W multiples of {CELL}"\n\n'
        "[model.reblur.outputs]\n"
        'judgement = "(1, H, W, 2) float32: share of the ordered layers in [0, 1], relative change '
        'of the near coverage in [-0.5, 0.5]"\n'
    )


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=HERE / "reblur.onnx")
    options = parser.parse_args()
    network = load_network(options.checkpoint)
    export(network, options.out)
    if options.out.parent == HERE:
        halves = {name: value.half() for name, value in network.state_dict().items()}
        torch.save(halves, HERE / "weights.pt")
        write_entry(HERE.parent / "manifest.toml", "reblur", entry(options.out))
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
