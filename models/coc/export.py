"""Write the trained network as ONNX, any frame size, with its entry in the manifest.

    python -m models.coc.export --checkpoint /tmp/coc_run/checkpoint.pt

`--checkpoint` is a run's checkpoint (its averaged weights are taken) or the committed
`models/coc/weights.pt`. The weights are stored in half precision and widened on loading, so
that the file is small and the arithmetic stays single precision.
"""

from __future__ import annotations

from pathlib import Path

from torch import Tensor, nn

from models.coc.network import LABEL_STEP, STRIDE, CocNet, coc_and_sigma
from models.exporting import load_into, run_export, write_onnx
from nlens_video.networks.onnx_networks import PRIOR

HERE = Path(__file__).parent
# of log(1 + CoC) in the last part of the training: drawn pictures and three in twenty rendered
LOG_COC_MEAN, LOG_COC_DEVIATION = 2.06, 1.03


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
    return load_into(CocNet(), path)


def export(network: CocNet, path: Path) -> None:
    """Write the ONNX file."""
    write_onnx(
        Shipped(network), path, {"rgb": (1, 4 * STRIDE, 6 * STRIDE, 3)}, ("coc_px", "sigma_px"),
        {"rgb": {1: "H", 2: "W"}},
        note="CoC diameter of a picture; see the model card beside this file",
        properties={PRIOR: f"{LOG_COC_MEAN} {LOG_COC_DEVIATION}"},
    )  # fmt: skip


def main() -> None:
    """Export a checkpoint, keep its weights in half precision, update the manifest."""
    shape = f"(1, H / {LABEL_STEP}, W / {LABEL_STEP})"
    run_export(
        __doc__, load_network, export, HERE / "coc.onnx",
        {"rgb": f"(1, H, W, 3) float32, sRGB code in [0, 1]; H, W multiples of {STRIDE}"},
        {
            "coc_px": f"{shape} float32, CoC diameter, px of the input",
            "sigma_px": f"{shape} float32, expected absolute error of it, px of the input",
        },
    )  # fmt: skip


if __name__ == "__main__":
    main()
