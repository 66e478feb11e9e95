"""The plate's blur in colours, where the lens is in focus, and the plot of the fit."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, CocMap, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.report.fit import fit_plot, unit_name
from nlens_video.report.maps import COC_MAP, Scale
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import Regression
from nlens_video.studio.plate_frames import levels_to_jpeg

_IN_FOCUS_PX = 1.0
_OPACITY = 0.65  # of the colours over the grey picture
_RAMP = 5


class Inspection(Struct, frozen=True, kw_only=True):
    """The frame on which the lens is found, its blur, and the lens.

    Attributes:
        picture: the frame.
        coc: its blur.
        ground: the ground as its camera sees it, and the object's footprint.
        fit: the lens, None where none is found.
        regression: what it was fitted on, None where it is given.
        no_lens: why a render would stop, empty where it would not.
        unit_m: the scene's unit, None where it is not known [m].
    """

    picture: Picture
    coc: CocMap
    ground: GroundProjection
    fit: LensFit | None
    regression: Regression | None
    no_lens: str
    unit_m: float | None

    def in_focus(self) -> Bool:
        """Ground whose CoC is below a pixel by the fit (H, W)."""
        if self.fit is None or not self.fit.depends_on_depth:
            return np.zeros(self.ground.mask.shape, bool)
        disparity = self.ground.disparity
        return np.asarray((disparity > 0.0) & (abs(self.fit.coc_px(disparity)) < _IN_FOCUS_PX))

    def drawn(self) -> tuple[bytes, dict[str, Any]]:
        """The blur in colours as a JPEG file, and what the page shows beside it."""
        coc_px = self.coc.coc_px
        top = max(1.0, float(np.quantile(coc_px, 0.98)))
        scale = Scale(top_px=top, colormap=COC_MAP)
        grey = self.picture.shown().mean(axis=2, keepdims=True)
        mixed = _OPACITY * scale.colors(coc_px) / 255.0 + (1.0 - _OPACITY) * grey
        levels = np.round(255.0 * mixed).astype(np.uint8)
        levels[_outline(self.in_focus())] = 255
        ramp = scale.colors(np.linspace(0.0, top, _RAMP, dtype=np.float32)[None])[0]
        plot = ""
        if self.fit is not None and self.regression is not None:
            unit = unit_name(self.unit_m)
            plot = fit_plot(self.fit, self.regression.samples, None, unit, signed=False)
        return levels_to_jpeg(levels), {
            "top_px": top,
            "ramp": ramp.tolist(),
            "plot": plot,
            "no_lens": self.no_lens,
            "lens": "" if self.fit is None else self.fit.describe(),
        }


def _outline(mask: Bool) -> Bool:
    """The border of an area, about two pixels wide (H, W)."""
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    shrunk = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8))
    return np.asarray(grown != shrunk)
