"""Geometry of a shot: where its frames see the object, the object's shadow and the ground."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from nlens_video.cameras.placement import contact_point
from nlens_video.core.layers import Box, Float64
from nlens_video.effects.foreground.rotation_view import RotationView
from nlens_video.graph.base.view import View, bounds_near_frame
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight

_MARGIN = 0.5  # around the object, by its height: most of a soft shadow lies there [1]
_MIN_MARGIN_PX = 24  # least margin around the object and its shadow [px]
_MIN_SUN_HEIGHT = 0.1  # sine of a sun's elevation below which shadows leave every frame [1]
_STATIC_TOLERANCE = 1e-6  # difference between frames of the numbers of a static camera [1]
_CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))


class ShotGeometry(Struct, frozen=True):
    """The object, and how the frames of a shot see it.

    Attributes:
        scene: the object.
        view: how the plate's frames see it.
        ground_y: height of the ground, None for the object's lowest point [scene unit].
        light: may hold a known sun; None holds none.
    """

    scene: Scene
    view: View
    ground_y: float | None
    light: SceneLight | None = None

    def camera(self, time_s: float) -> Camera:
        """The camera at a time [s]."""
        return self.view.camera_at(self.scene, time_s)

    def is_static(self, times: Sequence[float]) -> bool:
        """Whether the camera is the same at all of some times [s]."""
        return all(_is_same(self.camera(one), self.camera(times[0])) for one in times[1:])

    def object_box(self, time_s: float) -> Box:
        """Bounding box of the object and its surroundings in the frame; empty out of view."""
        bounds = bounds_near_frame(self.scene, self.view, time_s)
        if bounds is None:
            return Box(0, 0, 0, 0)
        margin = max(_MIN_MARGIN_PX, round(_MARGIN * bounds.box.height))
        return bounds.box.expanded(margin).intersection(self.view.box)

    def shadow_box(self, time_s: float) -> Box:
        """Bounding box of the object's shadow in the frame; empty without a known sun."""
        posed, camera = self.scene.pose(time_s), self.camera(time_s)
        toward = None
        if self.light is not None:
            toward = self.light.toward_known_sun(camera, posed.lights)
        if toward is None or toward[1] < _MIN_SUN_HEIGHT:
            return Box(0, 0, 0, 0)
        corners = np.take_along_axis(posed.bounds().astype(np.float64), _CORNERS, axis=0)
        above = np.maximum(corners[:, 1] - self.contact(time_s)[1], 0.0)
        on_ground = camera.to_camera(corners - above[:, None] / toward[1] * toward)
        pixels = camera.pixels(on_ground[on_ground[:, 2] < 0.0])
        if not len(pixels):
            return Box(0, 0, 0, 0)
        (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0)
        around = Box(math.floor(x0), math.floor(y0), math.ceil(x1), math.ceil(y1))
        return around.expanded(_MIN_MARGIN_PX).intersection(self.view.box)

    def contact(self, time_s: float) -> Float64:
        """The point of the ground where the object stands (3,)."""
        return contact_point(self.scene.pose(time_s).vertices(), self.ground_y)

    def reference_view(self, time_s: float) -> RotationView:
        """A reference view for a camera that rotates, from where it is at a time [s]."""
        contact, solved = self.contact(time_s), self.view.solved
        return RotationView.looking_at(
            contact, self.camera(time_s),
            distortion_k1=solved.distortion_k1 if solved is not None else 0.0,
        )  # fmt: skip


def _is_same(one: Camera, other: Camera) -> bool:
    """Whether two cameras are the same."""
    lens = (one.fx, one.fy, one.cx, one.cy), (other.fx, other.fy, other.cx, other.cy)
    poses = one.world_from_camera, other.world_from_camera
    return np.allclose(*lens, rtol=_STATIC_TOLERANCE, atol=0.0) and np.allclose(
        *poses, rtol=0.0, atol=_STATIC_TOLERANCE
    )
