"""What the paper reports, beside the same kind of figure measured here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nlens_video.evaluate.composite.methods import (
    BLIND,
    DEFAULT,
    GAUSSIAN,
    NAIVE,
    TRUE_COC,
)
from nlens_video.evaluate.metrics import Interval
from nlens_video.evaluate.tables import NONE, grid

QUADRATIC, NETWORK = "disparity to quadratic CoC", "our network"
SOURCE = (
    "The paper's figures are those of \"Parameter-Free Neural Lens Blur Rendering for "
    'High-Fidelity Composites", tables 1 (one scene, nine variations) and 2 (three scenes, nine '
    "variations). Its scenes are not published: figures measured here are of other pictures, and "
    "only the distance between rows can be compared across."
)


_HEADING = ["row of the paper", "row here", "figure", "the paper's", "here"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """A figure of the paper and its like here.

    Attributes:
        what: measured in the paper.
        here: name of the row that stands beside it.
        key: of the figure.
        reported: in the paper.
    """

    what: str
    here: str
    key: str
    reported: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Figure:
    heading: str
    digits: int


_FIGURES = {
    "rmse_px": _Figure(heading="CoC of the plate, RMSE [px]", digits=2),
    "psnr_db": _Figure(heading="PSNR [dB]", digits=2),
    "ssim": _Figure(heading="SSIM", digits=3),
}


def _both(what: str, here: str, psnr_db: float, ssim: float) -> tuple[Beside, Beside]:
    return (
        Beside(what=what, here=here, key="psnr_db", reported=psnr_db),
        Beside(what=what, here=here, key="ssim", reported=ssim),
    )


TABLES = {
    "Table 1 of the paper: estimating the CoC, and blurring with the true CoC": (
        Beside(what="Ranftl et al.", here=QUADRATIC, key="rmse_px", reported=6.29),
        Beside(what="Ruan et al.", here=NETWORK, key="rmse_px", reported=4.07),
        *_both("Prakash et al., Gaussian", GAUSSIAN, 28.13, 0.90),
        *_both("Peng et al., network", TRUE_COC, 31.08, 0.89),
    ),
    "Table 2 of the paper: composites": (
        *_both("Naive Composites", NAIVE, 26.41, 0.73),
        *_both("Blind Aug. w/ DoF", BLIND, 27.88, 0.82),
        *_both("Ours", DEFAULT, 34.66, 0.97),
    ),
}


def paper_comparison(found: Mapping[tuple[str, str], Interval]) -> str:
    """Both tables as Markdown.

    Args:
        found: what was measured here, by name of the row and key of the figure.
    """
    parts = []
    for title, rows in TABLES.items():
        cells = [_row(beside, found.get((beside.here, beside.key))) for beside in rows]
        parts += [f"## {title}", grid(_HEADING, cells)]
    return "\n\n".join([*parts, SOURCE]) + "\n"


def _row(beside: Beside, interval: Interval | None) -> list[str]:
    figure = _FIGURES[beside.key]
    here = NONE if interval is None else interval.text(figure.digits)
    return [
        beside.what, beside.here, figure.heading, f"{beside.reported:.2f}", here,
    ]  # fmt: skip
