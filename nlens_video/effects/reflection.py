"""Planar reflection: the object mirrored by a glossy ground, with the CoC of its virtual image.

A camera mirrored at the plane sees the mirror image of the object. Such a camera is left-handed;
with its x axis reversed any renderer can draw it, and the picture is flipped left to right. The
virtual image lies as far behind the ground as the object stands above it, so its CoC follows from
its own depth, not the ground's.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Box, Float32, Float64, ObjectLayer
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.render.base.box_renderer import BoxRenderer
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination

_BEHIND = 1e-3  # share of its distance by which a virtual point may seem to lie above the ground


def mirrored_camera(camera: Camera, ground_y: float) -> Camera:
    """The camera below the ground that sees the mirror image, flipped left to right.

    Args:
        camera: above the ground.
        ground_y: height of the plane [scene unit].
    """
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    mirror[1, 3] = 2.0 * ground_y
    turned = np.diag([-1.0, 1.0, 1.0, 1.0])
    pose = mirror @ camera.world_from_camera @ turned
    return replace(camera, world_from_camera=pose, cx=camera.width - camera.cx)


def schlick(cosine: Float64, reflectance: float) -> Float64:
    """Share of the light that a dielectric reflects (Schlick 1994) [1].

    Args:
        cosine: of the angle between ray and normal, 0 to 1.
        reflectance: at normal incidence, 0 to 1 [1].
    """
    return np.asarray(reflectance + (1.0 - reflectance) * (1.0 - cosine) ** 5)


class RenderReflection(Struct, frozen=True, kw_only=True):
    """Renders the mirror image, sharp.

    Attributes:
        renderer: of the object.
        reflectance: of the ground at normal incidence, 0 to 1 [1].
    """

    renderer: BoxRenderer
    reflectance: float

    def __call__(
        self, time_s: float, camera: Camera, ground_y: float, reach_px: float,
        plate_light: Illumination | None = None,
    ) -> ObjectLayer | None:  # fmt: skip
        """Render one moment.

        Args:
            time_s: time of the animation [s].
            camera: at that time.
            ground_y: height of the plane [scene unit].
            reach_px: reach of its blur [px].
            plate_light: lights the object where its file does not; None for a plausible light.

        Returns:
            The layer, times its reflectance, at the depth of the virtual image; None out of view.
        """
        if camera.world_from_camera[1, 3] <= ground_y:
            return None
        margin = math.ceil(min(reach_px, furthest_reach(camera.fy / camera.fx))) + 1
        mirrored = mirrored_camera(camera, ground_y)
        seen = self.renderer.render(time_s, mirrored, margin, plate_light=plate_light)
        if seen is None:
            return None
        box = Box(camera.width - seen.box.x1, seen.box.y0, camera.width - seen.box.x0, seen.box.y1)
        depth = np.ascontiguousarray(seen.depth[:, ::-1])
        share = self._mirrored(camera, box, ground_y, depth)
        rgba = np.ascontiguousarray(seen.rgba[:, ::-1]) * share[..., None]
        return ObjectLayer(box=box, rgba=rgba, depth=depth) if rgba[..., 3].any() else None

    def _mirrored(self, camera: Camera, box: Box, ground_y: float, depth: Float32) -> Float32:
        """Reflectance of the ground (h, w), 0 where the image does not lie behind it."""
        cut = camera.cropped(box)
        disparity = cut.plane_disparity(ground_y)
        height = camera.world_from_camera[1, 3] - ground_y
        x = (np.arange(box.width) + 0.5 - cut.cx) / cut.fx
        y = (np.arange(box.height) + 0.5 - cut.cy) / cut.fy
        ray = np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)  # longer than the depth by so much
        cosine = np.clip(height * disparity / ray, 0.0, 1.0)
        # pixels without depth, at an antialiased edge, count as behind
        below = disparity > 0.0
        behind = below & (depth >= (1.0 - _BEHIND) / np.where(below, disparity, 1.0))
        return np.asarray(schlick(cosine, self.reflectance) * behind, dtype=np.float32)
