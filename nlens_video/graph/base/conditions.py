"""Conditions on a frame under which nodes run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.graph.base.node import Condition
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX

if TYPE_CHECKING:
    from nlens_video.core.layers import Box, DefocusedLayer
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.graph.base.object_source import ScreenBounds

STEP_PX = 2.0  # CoC difference of neighbours below which overlapping parts look the same [px]


def _in_frame(bounds: ScreenBounds, frame_box: Box) -> bool:
    return not bounds.box.intersection(frame_box).empty


def _depth_steps(defocused: DefocusedLayer) -> bool:
    hides = defocused.behind is not None and not defocused.behind.box.empty
    return hides or defocused.largest_step_px >= STEP_PX


def _depth_range(bounds: ScreenBounds, fit: LensFit) -> bool:
    return fit.slope * (1.0 / bounds.nearest - 1.0 / bounds.farthest) >= STEP_PX


def _out_of_focus(defocused: DefocusedLayer) -> bool:
    return defocused.largest_coc_px >= NEGLIGIBLE_COC_PX


IN_FRAME = Condition("in-frame", "the object is in the frame", _in_frame)
DEPTH_STEPS = Condition(
    "depth-steps", f"the CoC steps by {STEP_PX} px inside the object", _depth_steps
)
DEPTH_RANGE = Condition("depth-range", f"the object's CoC spans {STEP_PX} px", _depth_range)
OUT_OF_FOCUS = Condition(
    "out-of-focus", f"the object's CoC reaches {NEGLIGIBLE_COC_PX} px", _out_of_focus
)
CONDITIONS = {one.name: one for one in (IN_FRAME, DEPTH_STEPS, DEPTH_RANGE, OUT_OF_FOCUS)}
