"""The plate past a blurred edge, where the object hides part of the lens from it.

What stands behind an edge out of focus is seen by the rest of the lens only, from one side. How far
that displaces it follows from its own CoC, which is the fit's on the virtual ground plane, as far
as the plate shows that plane.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.reblur.coc_discontinuities import extend_nearest
from nlens_video.kernels.reblur.edge_parallax import edge_parallax_layer
from nlens_video.scene.camera import Camera

MARGIN_PX = 48
"""The farthest that the plate is displaced [px]."""


def edge_parallax(
    blurred: BlurredLayer,
    picture: Picture,
    defocused: DefocusedLayer,
    fit: LensFit,
    camera: Camera,
    ground_y: float,
) -> BlurredLayer:
    """The object's layer with the plate past its edges as the free part of the lens sees it.

    Args:
        blurred: the object as the lens sees it, inside the frame.
        picture: the plate that it is laid over; left as it is.
        defocused: the sharp object and its CoC.
        fit: the lens, and how much of the ground its plate shows.
        camera: of the frame.
        ground_y: height of the ground plane in the world [scene unit].
    """
    box = blurred.box
    frame = Box(0, 0, picture.width, picture.height)
    if box.empty or defocused.layer.box.empty or not fit.ground_seen:
        return blurred
    part = replace(
        camera, cx=camera.cx - box.x0, cy=camera.cy - box.y0, width=box.width, height=box.height
    )
    disparity = np.maximum(part.plane_disparity(ground_y), 0.0).astype(np.float32)
    share = fit.ground_share(disparity)
    if not share.any():
        return blurred
    object_coc = _around(defocused, box)
    plate_coc = np.minimum(fit.coc_px(disparity), object_coc)  # it is behind the object
    aspect = camera.fy / camera.fx
    farthest = 0.5 * float(np.abs(plate_coc[share > 0.0]).max()) * max(1.0, aspect)
    margin = math.ceil(min(farthest, MARGIN_PX)) + 1
    wide = box.expanded(margin)
    inside = wide.intersection(frame)
    plate = np.pad(
        picture.linear(inside),
        (
            (inside.y0 - wide.y0, wide.y1 - inside.y1),
            (inside.x0 - wide.x0, wide.x1 - inside.x1),
            (0, 0),
        ),
        mode="edge",
    )
    rgba = edge_parallax_layer(
        blurred.rgba, plate, object_coc, plate_coc, share,
        margin=margin, pixel_aspect=aspect,
    )  # fmt: skip
    return BlurredLayer(box=box, rgba=rgba)


def _around(defocused: DefocusedLayer, box: Box) -> Float32:
    """The CoC of the object's nearest covered pixel (h, w), on a box."""
    held = defocused.layer.box
    whole = held.union(box)
    coc = np.zeros((whole.height, whole.width), np.float32)
    covered = np.zeros(coc.shape, np.bool_)
    coc[held.slices_in(whole)] = defocused.coc_px
    covered[held.slices_in(whole)] = defocused.layer.rgba[..., 3] > 0.0
    return np.ascontiguousarray(extend_nearest(coc, covered)[box.slices_in(whole)])
