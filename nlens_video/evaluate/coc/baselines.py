"""What our estimate of the plate's CoC is held against, and what each is told beside the plate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.evaluate.coc.quadratic import nearest_blur, quadratic_coc
from nlens_video.evaluate.coc.reblur_ratio import edge_blur, reblur_ratio_coc
from nlens_video.evaluate.plates import Plate


@dataclass(frozen=True, slots=True, kw_only=True)
class Baseline:
    """A way to estimate the CoC of a whole plate.

    Attributes:
        name: of its row.
        told: what it is told beside the plate, in words; empty if nothing.
        estimate: unsigned CoC (H, W) [px], None on a plate that lacks what it needs.
        also_scaled: whether it is also shown with the factor that suits the truth best.
    """

    name: str
    told: str = ""
    estimate: Callable[[Plate], Float32 | None]
    also_scaled: bool = False


def _from_sharp(plate: Plate) -> Float32 | None:
    if plate.sharp is None:
        return None
    return quadratic_coc(nearest_blur(plate.rgb, plate.sharp), plate.relative_disparity)


BASELINES = (
    Baseline(
        name="Zhuo & Sim 2011, re-blur ratio", estimate=lambda plate: reblur_ratio_coc(plate.rgb)
    ),
    Baseline(
        name="Blind Augmentation on edges",
        told="the true depth of every pixel, and reads the blur at edges by the re-blur ratio",
        estimate=lambda plate: quadratic_coc(edge_blur(plate.rgb), plate.relative_disparity),
    ),
    Baseline(
        name="Blind Augmentation on the sharp picture",
        told="the true depth of every pixel and the true sharp picture of the same view",
        estimate=_from_sharp,
        also_scaled=True,
    ),
    Baseline(
        name="best constant",
        told="the mean of the true CoC",
        estimate=lambda plate: best_constant(plate.true_coc_px),
    ),
)
SCALED = ", best factor"


def what_they_are_told() -> str:
    """A note below their table."""
    lines = [f"{base.name} is told {base.told}" for base in BASELINES if base.told]
    return (
        f"{'; '.join(lines)}. With the best factor its diameters are also scaled by the factor "
        "that suits the truth of that plate best. A dash: no sharp picture was rendered. "
        "Our estimate and Zhuo & Sim are told nothing."
    )


def best_constant(truth: Float32) -> Float32:
    """The constant map (H, W) with the least RMSE against a true CoC (H, W), its mean [px].

    It is taken from the truth: an estimate has to beat it before it says anything about the plate.
    """
    return np.full(truth.shape, truth.mean(), np.float32)
