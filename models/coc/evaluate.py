"""How good a CoC estimate is: on held-out drawn pictures, and on rendered plates with known CoC.

    python -m models.coc.evaluate --plates FOLDER [--onnx models/coc/coc.onnx] [--out figures.csv]

FOLDER holds one folder a plate with `bg.png` and `bg_coc.npy` (signed CoC diameter, px).
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]
Estimate = Callable[[Float32], tuple[Float32, Float32]]


@dataclass(frozen=True, slots=True)
class Figures:
    """Errors of one CoC map against the truth.

    Attributes:
        name: plate or data set.
        rmse_px: over the whole picture.
        confident_rmse_px: over the half with the smallest sigma.
        confident_bias_px: mean of estimate - truth over that half.
        relative: median of |error| / truth where the truth exceeds 2 px.
        honesty: mean |error| / mean sigma, 1 when sigma tells the truth, above when overconfident.
        confident_honesty: the same over the confident half.
    """

    name: str
    rmse_px: float
    confident_rmse_px: float
    confident_bias_px: float
    relative: float
    honesty: float
    confident_honesty: float

    def line(self) -> str:
        """One line for a log."""
        return (
            f"{self.name:13s} rmse {self.rmse_px:5.2f}  confident {self.confident_rmse_px:5.2f}"
            f"  bias {self.confident_bias_px:+5.2f}  median {100 * self.relative:4.1f} %"
            f"  honesty {self.honesty:4.2f} / {self.confident_honesty:4.2f}"
        )


def figures(name: str, coc: Float32, sigma: Float32, truth: Float32) -> Figures:
    """Compare CoC and sigma with the truth, arrays of one shape [px]."""
    error = coc - truth
    confident = sigma <= np.median(sigma)
    blurred = truth > 2
    relative = np.abs(error[blurred]) / truth[blurred] if blurred.any() else np.zeros(1)
    return Figures(
        name,
        float(np.sqrt(np.mean(error**2))),
        float(np.sqrt(np.mean(error[confident] ** 2))),
        float(np.mean(error[confident])),
        float(np.median(relative)),
        float(np.abs(error).mean() / sigma.mean()),
        float(np.abs(error[confident]).mean() / sigma[confident].mean()),
    )


def plates(folder: Path) -> Iterator[tuple[str, Float32, Float32]]:
    """Name, display-coded RGB (H, W, 3) and unsigned CoC (H, W) [px] of every still."""
    for truth in sorted(folder.glob("*_*/bg_coc.npy")):
        if truth.parent.name.startswith("seq_"):
            continue
        picture = cv2.imread(str(truth.parent / "bg.png"))[..., ::-1]
        yield truth.parent.name, np.float32(picture) / 255, np.abs(np.float32(np.load(truth)))


def evaluate_plates(estimate: Estimate, folder: Path) -> list[Figures]:
    """Figures of an estimator on every plate, then their mean."""
    rows = [figures(name, *estimate(rgb), truth) for name, rgb, truth in plates(folder)]
    if rows:
        keys = [key for key in asdict(rows[0]) if key != "name"]
        mean = {key: float(np.mean([getattr(row, key) for row in rows])) for key in keys}
        rows.append(Figures("mean", **mean))
    return rows


def onnx_estimate(path: Path) -> Estimate:
    """The shipped stage on the shipped weights."""
    from nlens_video.networks.onnx_networks import OnnxCocNetwork
    from nlens_video.stages.f_coc import estimate_coc

    network = OnnxCocNetwork(path)

    def estimate(rgb: Float32) -> tuple[Float32, Float32]:
        result = estimate_coc(network, rgb)
        return result.coc_px, result.sigma_px

    return estimate


def main() -> None:
    """Print the figures of an exported network, and write them where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plates", type=Path, required=True)
    parser.add_argument("--onnx", type=Path, default=Path(__file__).with_name("coc.onnx"))
    parser.add_argument("--out", type=Path, help="CSV")
    options = parser.parse_args()
    rows = evaluate_plates(onnx_estimate(options.onnx), options.plates)
    for row in rows:
        print(row.line())
    if options.out:
        with options.out.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(asdict(rows[0])))
            writer.writeheader()
            writer.writerows(
                {key: _short(value) for key, value in asdict(row).items()} for row in rows
            )


def _short(value: float | str) -> float | str:
    return value if isinstance(value, str) else round(value, 4)


if __name__ == "__main__":
    main()
