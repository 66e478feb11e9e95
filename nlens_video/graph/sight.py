"""An object and its surroundings as the frames of a shot see them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlens_video.cameras.placement import contact_point
from nlens_video.core.layers import Box, Float64
from nlens_video.effects.foreground.turned_canvas import TurnedCanvas
from nlens_video.graph.base.view import View, bounds_near_frame
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight

_MARGIN = 0.5  # of the object's height, around it: most of a soft shadow lies there [1]
_LEAST_MARGIN_PX = 24
_LOWEST = 0.1  # height of a sun (sine) below which shadows reach out of every frame
_STILL = 1e-6  # by which a still camera's numbers may differ from frame to frame [1]
_CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))


@dataclass(frozen=True, slots=True)
class Sight:
    """The object, and how the frames see it.

    Attributes:
        scene: the object.
        view: how the plate's frames see it.
        ground_y: height of the ground, None for the object's lowest point [scene unit].
        light: what may tell a sun; None tells none.
    """

    scene: Scene
    view: View
    ground_y: float | None
    light: SceneLight | None = None

    def camera(self, time_s: float) -> Camera:
        """The camera at a moment [s]."""
        return self.view.camera_at(self.scene, time_s)

    def stays(self, times: Sequence[float]) -> bool:
        """Whether the camera sees the same at all of these moments [s]."""
        return all(_same(self.camera(one), self.camera(times[0])) for one in times[1:])

    def place(self, time_s: float) -> Box:
        """Where the object is and what is close to it, inside the frame; empty where not."""
        bounds = bounds_near_frame(self.scene, self.view, time_s)
        if bounds is None:
            return Box(0, 0, 0, 0)
        margin = max(_LEAST_MARGIN_PX, round(_MARGIN * bounds.box.height))
        return bounds.box.expanded(margin).intersection(self.view.box)

    def shadow(self, time_s: float) -> Box:
        """Where its shadow lies by a sun that is known, inside the frame; else empty."""
        posed, camera = self.scene.pose(time_s), self.camera(time_s)
        toward = None
        if self.light is not None:
            toward = self.light.toward_known_sun(camera, posed.lights)
        if toward is None or toward[1] < _LOWEST:
            return Box(0, 0, 0, 0)
        ends = np.take_along_axis(posed.bounds().astype(np.float64), _CORNERS, axis=0)
        above = np.maximum(ends[:, 1] - self.contact(time_s)[1], 0.0)
        seen = camera.to_camera(ends - above[:, None] / toward[1] * toward)
        places = camera.pixels(seen[seen[:, 2] < 0.0])
        if not len(places):
            return Box(0, 0, 0, 0)
        (x0, y0), (x1, y1) = places.min(axis=0), places.max(axis=0)
        around = Box(math.floor(x0), math.floor(y0), math.ceil(x1), math.ceil(y1))
        return around.expanded(_LEAST_MARGIN_PX).intersection(self.view.box)

    def contact(self, time_s: float) -> Float64:
        """The point of the ground where the object stands (3,)."""
        return contact_point(self.scene.pose(time_s).vertices(), self.ground_y)

    def canvas(self, time_s: float) -> TurnedCanvas:
        """Where the frames of a camera that turns are laid, of which one is of that moment."""
        contact, solved = self.contact(time_s), self.view.solved
        return TurnedCanvas.towards(
            contact, self.camera(time_s),
            distortion_k1=solved.distortion_k1 if solved is not None else 0.0,
        )  # fmt: skip


def _same(one: Camera, other: Camera) -> bool:
    """Whether two cameras see the same."""
    lens = (one.fx, one.fy, one.cx, one.cy), (other.fx, other.fy, other.cx, other.cy)
    poses = one.world_from_camera, other.world_from_camera
    return np.allclose(*lens, rtol=_STILL, atol=0.0) and np.allclose(*poses, rtol=0.0, atol=_STILL)
