"""Depth peeling (Everitt 2001): the second layer of surfaces, which parts of the lens see.

The second layer begins where its CoC differs from that of the first by a visible step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlens_video.core.layers import Box, DefocusedLayer, HiddenLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.reblur.coc_discontinuities import STEP_PX
from nlens_video.stages.l_reblur import object_coc
from nlens_video.stages.protocols import BehindRenderer


def depth_peel(
    defocused: DefocusedLayer, fit: LensFit, farthest: float, renderer: BehindRenderer
) -> DefocusedLayer:
    """The layer, and what it hides by a step of the CoC and more.

    Args:
        defocused: the object, as the renderer has drawn it last.
        fit: the lens, in the pixels of the frame, with a slope > 0.
        farthest: greatest depth of the object [scene unit].
        renderer: draws what lies behind.
    """
    least = fit.coc_px(np.array([1.0 / farthest], np.float32))[0]
    region = _nearer(defocused, least + np.float32(STEP_PX))
    seen = None
    if not region.empty:
        seen = renderer.render_behind(defocused.layer, region, STEP_PX / fit.slope)
    if seen is None:
        return replace(defocused, behind=HiddenLayer.nothing())
    behind = HiddenLayer(
        box=region,
        rgba=seen.hidden.rgba,
        coc_px=object_coc(seen.hidden, fit).coc_px,
        front_rgba=seen.front_rgba,
    )
    return replace(defocused, behind=behind)


def _nearer(defocused: DefocusedLayer, coc_px: np.float32) -> Box:
    """Bounds of what has a CoC of so much at least: only that can hide what has a step less."""
    near = (defocused.layer.rgba[..., 3] > 0) & (defocused.coc_px >= coc_px)
    return Box.of(near).moved(defocused.layer.box.x0, defocused.layer.box.y0)
