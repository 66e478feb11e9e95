"""Write the trained network as ONNX, any frame size, with its entry in the manifest.

    python -m models.coc.export --checkpoint /tmp/coc_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/coc/weights.pt`. The weights are stored in half precision and widened on loading, so
that the file is small and the arithmetic stays single precision.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from models.coc.network import LABEL_STEP, STRIDE, CocNet, coc_and_sigma
from models.manifest import sha256_of, write_entry
from nlens_video.networks.coc_onnx import PRIOR

HERE = Path(__file__).parent
# of log(1 + CoC) in training: four fifths drawn pictures (2.36, 1.05), one rendered (1.98, 0.73)
LOG_COC_MEAN, LOG_COC_DEVIATION = 2.28, 1.0
SMALLEST_HALVED = 64  # shorter tensors (biases, constants) stay in single precision


class Shipped(nn.Module):
    """The shipped interface: RGB (1, H, W, 3) to CoC and sigma (1, H/4, W/4) [px]."""

    def __init__(self, network: CocNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, rgb: Tensor) -> tuple[Tensor, Tensor]:
        """CoC diameter and its expected absolute error, px of the input."""
        return coc_and_sigma(self.network(rgb.permute(0, 3, 1, 2)))


def load_network(path: Path) -> CocNet:
    """The network with the averaged weights of a checkpoint, or with shipped ones."""
    state = torch.load(path, weights_only=True)
    state = state.get("average", state)
    network = CocNet().eval()
    network.load_state_dict({name: value.float() for name, value in state.items()})
    return network


def with_half_weights(model: onnx.ModelProto) -> onnx.ModelProto:
    """The same graph with its large weights stored in half precision behind a cast."""
    casts = []
    for tensor in list(model.graph.initializer):
        values = numpy_helper.to_array(tensor)
        if values.dtype != "float32" or values.size < SMALLEST_HALVED:
            continue
        half = numpy_helper.from_array(values.astype("float16"), tensor.name + ".half")
        casts.append(helper.make_node("Cast", [half.name], [tensor.name], to=TensorProto.FLOAT))
        model.graph.initializer.remove(tensor)
        model.graph.initializer.append(half)
    nodes = [*casts, *model.graph.node]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    return model


def export(network: CocNet, path: Path) -> None:
    """Write the ONNX file."""
    buffer = io.BytesIO()
    torch.onnx.export(
        Shipped(network).eval(),
        (torch.rand(1, 4 * STRIDE, 6 * STRIDE, 3),),
        buffer,
        input_names=["rgb"],
        output_names=["coc_px", "sigma_px"],
        dynamic_axes={"rgb": {1: "H", 2: "W"}},
        opset_version=18,
        dynamo=False,  # a hundred times faster than the new exporter, and the same graph here
    )
    model = with_half_weights(onnx.load_from_string(buffer.getvalue()))
    for node in model.graph.node:  # names of source files
        node.doc_string = ""
    model.doc_string = "CoC diameter of a picture; see the model card beside this file"
    helper.set_model_props(model, {PRIOR: f"{LOG_COC_MEAN} {LOG_COC_DEVIATION}"})
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def entry(weights: Path) -> str:
    """The manifest's entry: the file's hash and shapes, where the program looks them up."""
    shape = f"(1, H / {LABEL_STEP}, W / {LABEL_STEP})"
    return (
        "[model.coc]\n"
        f'file = "{weights.parent.name}/{weights.name}"\n'
        f'sha256 = "{sha256_of(weights)}"\n'
        'licence = "Apache-2.0"\n'
        'card = "coc/README.md"\n\n'
        "[model.coc.inputs]\n"
        f'rgb = "(1, H, W, 3) float32, sRGB code in [0, 1]; H, W multiples of {STRIDE}"\n\n'
        "[model.coc.outputs]\n"
        f'coc_px = "{shape} float32, CoC diameter, px of the input"\n'
        f'sigma_px = "{shape} float32, expected absolute error of it, px of the input"\n'
    )


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=HERE / "coc.onnx")
    options = parser.parse_args()
    network = load_network(options.checkpoint)
    export(network, options.out)
    if options.out.parent == HERE:
        halves = {name: value.half() for name, value in network.state_dict().items()}
        torch.save(halves, HERE / "weights.pt")
        write_entry(HERE.parent / "manifest.toml", "coc", entry(options.out))
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
