"""The blur that several stages share: a layer as the plate's lens shows it."""

from __future__ import annotations

from functools import partial

from nlens_video.core.errors import UsageError
from nlens_video.graph.nodes.context import Tools
from nlens_video.stages.l_reblur import ReblurLayer


def through_lens(tools: Tools, detail: str = "fine") -> ReblurLayer:
    """What spreads each pixel of a layer over its disc.

    Args:
        tools: what a run's stages share.
        detail: `fine`, or `draft` for what is soft anyway.

    Raises:
        UsageError: there is no such detail.
    """
    from nlens_video.kernels.scatter.scatter import (
        DRAFT,
        FINE,
        blur_reach,
        scatter,
    )

    details = {"fine": FINE, "draft": DRAFT}
    if detail not in details:
        raise UsageError(f"stage 'scatter': no detail {detail!r}; there are {', '.join(details)}")
    drawn = details[detail]
    return ReblurLayer(
        scatter=partial(scatter, aperture=tools.aperture, detail=drawn, spread=tools.spread),
        reach=partial(blur_reach, aperture=tools.aperture, detail=drawn),
        pixel_aspect=tools.pixel_aspect,
    )
