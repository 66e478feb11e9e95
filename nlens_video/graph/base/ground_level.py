"""Where the ground lies that nobody gave, and whether the object stands on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nlens_video.core.errors import Note, NoteKind
from nlens_video.graph.base.object_source import ObjectSource
from nlens_video.graph.base.timeline import moments_of
from nlens_video.graph.base.view import View
from nlens_video.scene.camera import Camera
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.screen_projection import mesh_extents

_BELOW = 0.05  # of the object's height: so far below the ground nothing stands [1]
_ABOVE = 0.25  # of its height: as near to the ground it comes that is meant for it [1]
_APART = 0.1  # of its height: parts with more air between them are no body [1]


def note_on_ground(objects: ObjectSource, ground_y: float) -> Note:
    """The height of a ground that nobody gave; a doubt where the object does not stand on it.

    Args:
        objects: the objects.
        ground_y: the lowest point of their footprint on the first frame [scene unit].
    """
    scene, view = objects.scene, objects.view
    if objects.footprint_node is not None:
        return _information(f"y = {ground_y:.4g}, the lowest point of --footprint-node")
    stands = [
        stand
        for time_s in moments_of(scene, view.length_s)
        if (stand := _stand(scene.pose(time_s), view.camera_at(scene, time_s), view)) is not None
    ]
    lowest = min((low for low, _ in stands), default=ground_y)
    height = max((high - low for low, high in stands), default=0.0)
    known, fits = _rounded(ground_y, height), _rounded(lowest, height)
    where = f"y = {known:g}, the object's lowest point on the first frame"
    if lowest < ground_y - _BELOW * height:
        came = f"the object comes to lie {ground_y - lowest:.3g} below the ground"
    elif lowest > ground_y + _ABOVE * height:
        came = f"what is in view of the object stays {lowest - ground_y:.3g} above the ground"
    else:
        return _information(where)
    line = f"{came} ({where}); if it stands there, give --ground-y {fits:g}"
    return Note(line, NoteKind.UNCERTAIN)


def _information(where: str) -> Note:
    return Note(f"ground at {where}; --ground-y gives another", NoteKind.INFORMATION)


def _stand(posed: PosedScene, camera: Camera, view: View) -> tuple[float, float] | None:
    """Least and greatest height of what is in view at a moment; None where nothing is."""
    spans, seen = [], []
    for mesh, extent in zip(posed.drawn, mesh_extents(posed, camera), strict=True):
        heights = mesh.exact(posed.origin)[:, 1]
        spans.append((float(heights.min()), float(heights.max())))
        seen.append(extent.meets(view.box))
    return _body(spans, seen) if any(seen) else None


def _body(spans: Sequence[tuple[float, float]], seen: Sequence[bool]) -> tuple[float, float]:
    """Heights of the parts that are seen, with those below that are hardly apart from them."""
    low = min(span[0] for span, one in zip(spans, seen, strict=True) if one)
    high = max(span[1] for span, one in zip(spans, seen, strict=True) if one)
    for bottom, top in sorted(spans, key=lambda span: -span[1]):
        if top >= low - _APART * (high - low):
            low = min(low, bottom)
    return low, high


def _rounded(height: float, size: float) -> float:
    """A height to about a thousandth of a size."""
    digits = 3 - math.floor(math.log10(size)) if size > 0.0 else 6
    return float(np.round(height, digits)) + 0.0  # no -0
