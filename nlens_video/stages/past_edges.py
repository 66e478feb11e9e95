"""The plate past a blurred edge, where the object hides part of the lens from it.

What stands behind an edge out of focus is seen by the rest of the lens only, from one side. How far
that displaces it follows from its own CoC, which is the fit's on the virtual ground plane, as far
as the plate's estimated CoC says that this is what is seen there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nlens_video.frames import (
    BlurredLayer,
    Box,
    CocMap,
    DefocusedLayer,
    Float32,
    Float64,
    Picture,
)
from nlens_video.kernels.half_hidden import half_hidden
from nlens_video.kernels.steps import carried_out
from nlens_video.lens import LensFit
from nlens_video.scene.camera import Camera
from nlens_video.stages.p_projection import GroundProjection

MARGIN_PX = 48
"""The farthest that the plate is displaced [px]."""

FLOOR_PX = 1.0
"""What the estimated CoC may be off by at least [px]."""

SMOOTH_PX = 8.0
"""Sigma over which neighbours are asked too [px]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundTrust:
    """Where the plate shows the virtual ground plane, by its blur.

    Attributes:
        share: how far to believe so (H, W), 0 to 1, 0 above the horizon [1].
        camera: that saw it.
        ground_y: height of the plane in the world [scene unit].
    """

    share: Float32
    camera: Camera
    ground_y: float

    def seen_by(self, camera: Camera, box: Box) -> tuple[Float32, Float64]:
        """Share and the plane's disparity (h, w) on a box of a camera's frame."""
        part = replace(
            camera, cx=camera.cx - box.x0, cy=camera.cy - box.y0, width=box.width, height=box.height
        )
        disparity = part.plane_disparity(self.ground_y)
        if _same(camera, self.camera):
            return np.ascontiguousarray(self.share[box.y0 : box.y1, box.x0 : box.x1]), disparity
        seen = self.camera.to_camera(part.plane_points(self.ground_y).reshape(-1, 3))
        before = seen[:, 2] < 0.0
        seen[~before, 2] = -1.0
        places = np.where(before[:, None], self.camera.pixels(seen) - 0.5, -9.0)
        places = np.clip(places, -9.0, 1e6).astype(np.float32)
        columns, rows = (places[:, axis].reshape(disparity.shape) for axis in (0, 1))
        share = cv2.remap(
            self.share, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        )
        return np.where(disparity > 0.0, share, np.float32(0.0)).astype(np.float32), disparity


def trust_ground(
    plate_coc: CocMap, ground: GroundProjection, fit: LensFit, camera: Camera
) -> GroundTrust:
    """See where the plate is as blurred as the ground plane would be.

    Args:
        plate_coc: its estimated CoC, on the whole frame.
        ground: the plane on the same frame.
        fit: the lens.
        camera: of that frame.
    """
    seen = ground.disparity > 0.0
    expected = np.abs(fit.coc_px(ground.disparity.astype(np.float32)))
    off = np.abs(expected - plate_coc.coc_px) / np.maximum(plate_coc.sigma_px, FLOOR_PX)
    alike = np.where(seen, np.clip(3.0 - off, 0.0, 1.0), 0.0).astype(np.float32)
    share = cv2.GaussianBlur(alike, (0, 0), SMOOTH_PX, borderType=cv2.BORDER_REPLICATE)
    return GroundTrust(
        share=np.where(seen, share, np.float32(0.0)).astype(np.float32),
        camera=camera,
        ground_y=ground.ground_y,
    )


def past_edges(
    blurred: BlurredLayer,
    picture: Picture,
    defocused: DefocusedLayer,
    trust: GroundTrust,
    fit: LensFit,
    camera: Camera,
) -> BlurredLayer:
    """The object's layer with the plate past its edges as the free part of the lens sees it.

    Args:
        blurred: the object as the lens sees it, inside the frame.
        picture: the plate that it is laid over; left as it is.
        defocused: the sharp object and its CoC.
        trust: where the plate shows the ground.
        fit: the lens.
        camera: of the frame.
    """
    box = blurred.box
    frame = Box(0, 0, picture.width, picture.height)
    if box.empty or defocused.layer.box.empty:
        return blurred
    share, disparity = trust.seen_by(camera, box)
    if not share.any():
        return blurred
    object_coc = _around(defocused, box)
    plate_coc = fit.coc_px(np.maximum(disparity, 0.0).astype(np.float32))
    plate_coc = np.minimum(plate_coc, object_coc)  # what is behind the object is farther off
    aspect = camera.fy / camera.fx
    farthest = 0.5 * float(np.abs(plate_coc[share > 0.0]).max()) * max(1.0, aspect)
    margin = math.ceil(min(farthest, MARGIN_PX)) + 1
    wide = box.grown(margin)
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
    rgba = half_hidden(
        blurred.rgba, plate, object_coc, np.ascontiguousarray(plate_coc, np.float32), share,
        margin=margin, pixel_aspect=aspect,
    )  # fmt: skip
    return BlurredLayer(box=box, rgba=rgba)


def _around(defocused: DefocusedLayer, box: Box) -> Float32:
    """The CoC of the object's nearest covered pixel (h, w), on a box."""
    held = defocused.layer.box
    whole = held.joined(box)
    coc = np.zeros((whole.height, whole.width), np.float32)
    covered = np.zeros(coc.shape, np.bool_)
    coc[held.slices_in(whole)] = defocused.coc_px
    covered[held.slices_in(whole)] = defocused.layer.rgba[..., 3] > 0.0
    return np.ascontiguousarray(carried_out(coc, covered)[box.slices_in(whole)])


def _same(one: Camera, other: Camera) -> bool:
    return bool(
        np.array_equal(one.world_from_camera, other.world_from_camera)
        and (one.fx, one.fy, one.cx, one.cy) == (other.fx, other.fy, other.cx, other.cy)
    )
