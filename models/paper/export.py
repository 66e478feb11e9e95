"""Write ARNet and IUNet as ONNX, any size, with their entries in the manifest.

    python -m models.paper.export --checkpoint /tmp/paper_run/checkpoint.pt

`--checkpoint` is a run's checkpoint or the committed `models/paper/weights.pt`. Weights are stored
in half precision and widened on loading.
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
from models.paper.network import ARNet, IUNet
from models.paper.train import PaperNets

HERE = Path(__file__).parent


def _first(picture: Tensor) -> Tensor:
    return picture.permute(0, 3, 1, 2)


def _last(picture: Tensor) -> Tensor:
    return picture.permute(0, 2, 3, 1)


class ShippedArnet(nn.Module):
    """code (1, H, W, 3), defocus (1, H, W, 1) to rendered (1, H, W, 4)."""

    def __init__(self, network: ARNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, code: Tensor, defocus: Tensor) -> Tensor:
        """Picture and error map."""
        return _last(self.network(_first(code), _first(defocus)))


class ShippedIunet(nn.Module):
    """code (1, H, W, 3), defocus (1, H, W, 1), coarse (1, H/2, W/2, 3) to refined (1, H, W, 3)."""

    def __init__(self, network: IUNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, code: Tensor, defocus: Tensor, coarse: Tensor) -> Tensor:
        """The picture at the full size."""
        return _last(self.network(_first(code), _first(defocus), _first(coarse)))


def load_networks(path: Path) -> PaperNets:
    """Both networks with the weights of a checkpoint, or with shipped ones."""
    state = torch.load(path, weights_only=True)
    state = state.get("nets", state)
    nets = PaperNets().eval()
    nets.load_state_dict({name: value.float() for name, value in state.items()})
    return nets


def _write(network: nn.Module, inputs: dict[str, tuple[int, ...]], output: str, path: Path) -> None:
    buffer = io.BytesIO()
    axes = {name: {1: f"{name}_H", 2: f"{name}_W"} for name in (*inputs, output)}
    torch.onnx.export(
        network.eval(),
        tuple(torch.rand(shape) for shape in inputs.values()),
        buffer,
        input_names=list(inputs),
        output_names=[output],
        dynamic_axes=axes,
        opset_version=18,
        dynamo=False,  # much faster than the new exporter, and the same graph here
    )
    model = with_half_weights(onnx.load_from_string(buffer.getvalue()))
    for node in model.graph.node:  # names of source files
        node.doc_string = ""
    model.doc_string = "BokehMe's shapes, trained anew; see the model card beside this file"
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, path)


def export(nets: PaperNets, folder: Path) -> tuple[Path, Path]:
    """Write both ONNX files."""
    arnet, iunet = folder / "arnet.onnx", folder / "iunet.onnx"
    whole = {"code": (1, 48, 64, 3), "defocus": (1, 48, 64, 1)}
    _write(ShippedArnet(nets.arnet), whole, "rendered", arnet)
    _write(ShippedIunet(nets.iunet), {**whole, "coarse": (1, 24, 32, 3)}, "refined", iunet)
    return arnet, iunet


def entry(name: str, weights: Path, inputs: dict[str, str], outputs: dict[str, str]) -> str:
    """A network's entry in the manifest."""
    tables = [
        f'[model.{name}]\nfile = "{weights.parent.name}/{weights.name}"\n'
        f'sha256 = "{sha256_of(weights)}"\nlicence = "Apache-2.0"\ncard = "paper/README.md"'
    ]
    for kind, values in (("inputs", inputs), ("outputs", outputs)):
        lines = "\n".join(f'{key} = "{value}"' for key, value in values.items())
        tables.append(f"[model.{name}.{kind}]\n{lines}")
    return "\n\n".join(tables) + "\n"


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=HERE, help="folder")
    options = parser.parse_args()
    nets = load_networks(options.checkpoint)
    arnet, iunet = export(nets, options.out)
    if options.out == HERE:
        torch.save({k: v.half() for k, v in nets.state_dict().items()}, HERE / "weights.pt")
        seen = {
            "code": "(1, H, W, 3) float32, light^(1 / 2.2); H, W even",
            "defocus": "(1, H, W, 1) float32, signed radius / 10 px",
        }
        manifest = HERE.parent / "manifest.toml"
        rendered = {"rendered": "(1, H, W, 4) float32: code values, error map in [0, 1]"}
        write_entry(manifest, "paper-arnet", entry("paper-arnet", arnet, seen, rendered))
        coarse = {**seen, "coarse": "(1, H / 2, W / 2, 3) float32, code values"}
        refined = {"refined": "(1, H, W, 3) float32, code values"}
        write_entry(manifest, "paper-iunet", entry("paper-iunet", iunet, coarse, refined))
    print(*(f"{path}: {path.stat().st_size / 1e6:.2f} MB" for path in (arnet, iunet)), sep="\n")


if __name__ == "__main__":
    main()
