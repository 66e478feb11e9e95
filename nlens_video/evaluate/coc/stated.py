"""How the errors of a fit compare with what it states of them."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.plates import Plate
from nlens_video.evaluate.report import Column, Table

_UNSIGNED_PX = 1.0  # a true CoC below it has no sign that anyone could see


def stated_figures(plate: Plate, fit: LensFit | None) -> dict[str, float]:
    """What a fit says of its own errors against the truth; of a plate it refuses, that alone.

    Shares are 0 or 100, so that their mean over the plates is in percent.
    """
    if fit is None:
        return {"refused_percent": 100.0}
    disparity = 1.0 / plate.object_depth[plate.solid].astype(np.float64)
    coc_px = plate.object_coc_px[plate.solid].astype(np.float64)
    middle, true_px = float(np.median(disparity)), float(np.median(coc_px))
    found_px, stated_px = fit.slope * middle + fit.intercept, float(fit.coc_stderr_px(middle))
    resolved = fit.sign == "resolved"
    wrong = resolved and found_px * true_px < 0.0 and abs(true_px) > _UNSIGNED_PX
    figures = {
        "stated_px": stated_px,
        "refused_percent": 0.0,
        "resolved_percent": 100.0 * resolved,
        "wrong_percent": 100.0 * wrong,
    }
    slope, intercept = true_line(disparity, coc_px)
    for name, off, stated in (
        ("object", found_px - true_px, stated_px),
        ("slope", fit.slope - slope, fit.slope_stderr),
        ("intercept", fit.intercept - intercept, fit.intercept_stderr),
    ):
        errors = abs(off) / max(stated, 1e-9)
        for count, word in enumerate(("one", "two"), start=1):
            figures[f"{name}_within_{word}_percent"] = 100.0 * (errors <= count)
    return figures


def true_line(disparity: Float64, coc_px: Float64) -> tuple[float, float]:
    """Slope and intercept of the lens that gave points their CoC, by least squares.

    Args:
        disparity: of at least two depths (N,) [1 / scene unit].
        coc_px: signed diameters there (N,) [px].

    Returns:
        Slope [px * scene unit] and intercept [px].
    """
    middle = disparity.mean()
    away = disparity - middle
    slope = float((away * coc_px).sum() / max(float((away * away).sum()), 1e-300))
    return slope, float(coc_px.mean() - slope * middle)


def stated_table() -> Table:
    """An empty table of these figures."""
    within = (
        Column(f"{name}_within_{word}_percent", f"{name} within {word}, %", 0)
        for name in ("object", "slope", "intercept")
        for word in ("one", "two")
    )
    return Table(
        name="stated",
        title="The fit's own account of its errors",
        columns=(
            Column("stated_px", "stated error of the object's CoC, px"),
            *within,
            Column("resolved_percent", "sign resolved, %", 0),
            Column("wrong_percent", "resolved but wrong, %", 0),
            Column("refused_percent", "refused, %", 0),
        ),
        detail="stated_px",
        notes=(
            "Shares of the plates on which a fit was found, in percent; refused: of all. *Within "
            "one*, *within two*: off by at most one or two of the errors that the fit states; "
            "two thirds and 95 % are wanted. *Object*: the CoC in the middle of its depths. A true "
            f"CoC below {_UNSIGNED_PX:g} px counts as of either sign.",
        ),
    )
