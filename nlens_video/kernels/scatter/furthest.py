"""How far the scatter spreads light at most: how much beyond the frame can matter to it."""

from __future__ import annotations

from functools import cache

from nlens_video.kernels.scatter.disc import MAX_COC_PX, fitted_radius, reach
from nlens_video.kernels.scatter.scatter import FINE


@cache
def furthest_reach(pixel_aspect: float = 1.0) -> int:
    """`blur_reach` of the largest round disc, without its tables [px].

    Args:
        pixel_aspect: width of a pixel by its height, > 0 [1].
    """
    radius = 0.5 * MAX_COC_PX
    return reach(fitted_radius(radius * max(1.0, pixel_aspect))) + FINE.spread(radius)
