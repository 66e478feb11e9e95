"""The network with 8-bit convolutions: half the time and half the size, within 3 % of the accuracy.

    python -m models.coc.quantise --photos PHOTOS

Weights are quantised per channel, activations by the extremes that drawn pictures give them. The
first convolution sees faint texture and the last one answers over a wide range, so both stay in
single precision.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)

from models.coc.export import HERE, entry, export, load_network
from models.coc.scene import draw_scene
from models.coc.textures import Photos
from models.manifest import write_entry

PICTURES = 24  # drawn for the ranges of the activations


class DrawnPictures(CalibrationDataReader):  # type: ignore[misc]  # its module has no types
    """Pictures from the generator of the training data."""

    def __init__(self, photos: Photos, seed: int) -> None:
        self._batches = self._draw(photos, seed)

    @staticmethod
    def _draw(photos: Photos, seed: int) -> Iterator[dict[str, npt.NDArray[np.float32]]]:
        for index in range(PICTURES):
            picture, _ = draw_scene(np.random.default_rng([seed, index]), photos)
            yield {"rgb": np.float32(picture[None]) / 255}

    def get_next(self) -> dict[str, npt.NDArray[np.float32]] | None:
        """The next picture, None after the last."""
        return next(self._batches, None)


def quantise(single: Path, pictures: CalibrationDataReader, out: Path) -> None:
    """Write the 8-bit variant of a network in single precision."""
    names = [node.name for node in onnx.load(single).graph.node if node.op_type == "Conv"]
    quantize_static(
        single,
        out,
        pictures,
        quant_format=QuantFormat.QDQ,
        per_channel=True,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        op_types_to_quantize=["Conv"],
        nodes_to_exclude=[names[0], names[-1]],
        calibrate_method=CalibrationMethod.MinMax,
    )


def main() -> None:
    """Quantise the shipped weights and update the manifest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--checkpoint", type=Path, default=HERE / "weights.pt")
    parser.add_argument("--out", type=Path, default=HERE / "coc-int8.onnx")
    parser.add_argument("--seed", type=int, default=21)
    options = parser.parse_args()
    photos = Photos.load(options.photos, held_out=False)
    with tempfile.TemporaryDirectory() as folder:
        single = Path(folder) / "single.onnx"
        export(load_network(options.checkpoint), single, half_weights=False)
        quantise(single, DrawnPictures(photos, options.seed), options.out)
    if options.out.parent == HERE:
        write_entry(HERE.parent / "manifest.toml", "coc-int8", entry("coc-int8", options.out))
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
