"""A camera that hardly leaves its place, as one held by hand: little parallax, but some.

COLMAP leaves out points that are seen under less than a degree or two, and so nearly all of such a
shot. Without them nothing is solved; with them, the search may end at a wrong focal length. It
is begun at several.
"""

from __future__ import annotations

import math

from nlens_video.solve.paths.bundle import Bundle, bundle_of
from nlens_video.solve.paths.mapping import map_keyframes
from nlens_video.solve.points.observations import Table

_FOVS_DEG = (45.0, 60.0, 75.0)


def narrow_bundles(
    table: Table, count: int, size: tuple[int, int], focal_px: float | None
) -> list[Bundle]:
    """Keyframes whose points have little parallax, with one focal length, one for each beginning.

    Args:
        table: observations in the keyframes.
        count: number of keyframes.
        size: columns and rows [px].
        focal_px: focal length where it is known [px].
    """
    starts = [0.5 * size[0] / math.tan(0.5 * math.radians(fov)) for fov in _FOVS_DEG]
    found = []
    for start in starts if focal_px is None else [focal_px]:
        structure = map_keyframes(table, count, size, start, narrow=True)
        if structure is not None:
            bundle = bundle_of(structure, table, size, count)
            # What the first adjustment brings near is used by the second.
            found.append(bundle.adjusted(focal=focal_px is None).adjusted(focal=focal_px is None))
    return found
