"""Write ARNet and IUNet as ONNX, any size, with their entries in the manifest.

    python -m models.paper.export --checkpoint /tmp/paper_run/checkpoint.pt

`--checkpoint` is a run's checkpoint or the committed `models/paper/weights.pt`. Weights are stored
in half precision and widened on loading.
"""

from __future__ import annotations

from pathlib import Path

from torch import Tensor, nn

from models.exporting import arguments, load_into, update_manifest, write_onnx, write_weights
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
    return load_into(PaperNets(), path)


def _write(network: nn.Module, inputs: dict[str, tuple[int, ...]], output: str, path: Path) -> None:
    axes = {name: {1: f"{name}_H", 2: f"{name}_W"} for name in (*inputs, output)}
    note = "BokehMe's shapes, trained anew; see the model card beside this file"
    write_onnx(network, path, inputs, (output,), axes, note=note)


def export(nets: PaperNets, folder: Path) -> tuple[Path, Path]:
    """Write both ONNX files."""
    arnet, iunet = folder / "arnet.onnx", folder / "iunet.onnx"
    whole = {"code": (1, 48, 64, 3), "defocus": (1, 48, 64, 1)}
    _write(ShippedArnet(nets.arnet), whole, "rendered", arnet)
    _write(ShippedIunet(nets.iunet), {**whole, "coarse": (1, 24, 32, 3)}, "refined", iunet)
    return arnet, iunet


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    options = arguments(__doc__, HERE)
    nets = load_networks(options.checkpoint)
    arnet, iunet = export(nets, options.out)
    if options.out == HERE:
        write_weights(nets, HERE)
        seen = {
            "code": "(1, H, W, 3) float32, light^(1 / 2.2); H, W even",
            "defocus": "(1, H, W, 1) float32, signed radius / 10 px",
        }
        rendered = {"rendered": "(1, H, W, 4) float32: code values, error map in [0, 1]"}
        update_manifest("paper-arnet", arnet, seen, rendered)
        coarse = {**seen, "coarse": "(1, H / 2, W / 2, 3) float32, code values"}
        refined = {"refined": "(1, H, W, 3) float32, code values"}
        update_manifest("paper-iunet", iunet, coarse, refined)
    print(*(f"{path}: {path.stat().st_size / 1e6:.2f} MB" for path in (arnet, iunet)), sep="\n")


if __name__ == "__main__":
    main()
