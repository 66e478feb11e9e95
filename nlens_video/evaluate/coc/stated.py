"""How the errors of a fit compare with what it states of them."""

from __future__ import annotations

import numpy as np

from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.plates import Plate
from nlens_video.evaluate.report import Column, Table

_UNSIGNED_PX = 1.0  # a true CoC below it has no sign that anyone could see


def stated_figures(plate: Plate, fit: LensFit | None) -> dict[str, float]:
    """What a fit says of its own errors against the truth; empty where there is no fit.

    Shares are 0 or 100, so that their mean over the plates is in percent.
    """
    if fit is None:
        return {}
    disparity = 1.0 / plate.object_depth[plate.solid].astype(np.float64)
    true_px = float(np.median(plate.object_coc_px[plate.solid]))
    middle = float(np.median(disparity))
    found_px, stated_px = fit.slope * middle + fit.intercept, float(fit.coc_stderr_px(middle))
    off = abs(found_px - true_px) / max(stated_px, 1e-9)
    resolved = fit.sign == "resolved"
    wrong = resolved and found_px * true_px < 0.0 and abs(true_px) > _UNSIGNED_PX
    return {
        "stated_px": stated_px,
        "within_one_percent": 100.0 * (off <= 1.0),
        "within_two_percent": 100.0 * (off <= 2.0),
        "resolved_percent": 100.0 * resolved,
        "wrong_percent": 100.0 * wrong,
    }


def stated_table() -> Table:
    """An empty table of these figures."""
    return Table(
        name="stated",
        title="The fit's own account of its errors",
        columns=(
            Column("stated_px", "stated error of the object's CoC, px"),
            Column("within_one_percent", "within one, % of plates", 0),
            Column("within_two_percent", "within two, % of plates", 0),
            Column("resolved_percent", "sign resolved, % of plates", 0),
            Column("wrong_percent", "resolved but wrong, % of plates", 0),
        ),
        detail="stated_px",
        notes=(
            "Of the CoC in the middle of the object's depths. A true CoC below "
            f"{_UNSIGNED_PX:g} px counts as of either sign.",
        ),
    )
