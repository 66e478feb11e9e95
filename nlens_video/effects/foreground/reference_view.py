"""Reference view of a shot: the view that frames are warped into, where the background is at rest.

Three cases: a static camera (`StaticView`), a camera that rotates in place (`RotationView`), and a
camera that also travels, so that the background shows parallax (`ParallaxView`).
"""

from __future__ import annotations

import math
from typing import Protocol

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.effects.foreground.background import BackgroundModel, lowres_size, sqrt_light
from nlens_video.scene.camera import Camera

PixelMap = tuple[Float32, Float32]
"""Source columns and rows of pixels (h, w), for `cv2.remap`."""


class ReferenceView(Protocol):
    """A view that the frames of a shot are warped into."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows at full resolution, that of the frames [px]."""
        ...

    @property
    def lowres_size(self) -> tuple[int, int]:
        """Columns and rows at low resolution, at which motion is detected [px]."""
        ...

    def warp_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """Roots of light of a frame, its camera's rotation removed, at low resolution (h, w, 3).

        Targets keep their shape. The background may show parallax, see `render_background`. NaN
        beyond the frame.
        """
        ...

    def register_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """The same with parallax removed, too: the background is at rest.

        NaN also where the background is occluded.
        """
        ...

    def render_background(self, model: BackgroundModel, camera: Camera) -> BackgroundModel:
        """The background as `warp_lowres` shows it of a frame's camera."""
        ...

    def register_box(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """Roots of light of a box of this view (h, w, 3), registered; NaN beyond the frame."""
        ...

    def box_in_reference(self, box: Box, camera: Camera) -> Box:
        """Bounding box in this view of a box of a frame."""
        ...

    def box_in_frame(self, box: Box, camera: Camera) -> Box:
        """Bounding box in a frame of a box of this view."""
        ...

    def lowres_to_frame(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """Values at low resolution, as `warp_lowres` has them, warped to a box of a frame."""
        ...

    def box_to_frame(self, values: Float32, source: Box, camera: Camera, box: Box) -> Float32:
        """Registered values on a box of this view, warped to a box of a frame; NaN beyond them."""
        ...

    def ground_disparity(
        self, point: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """Disparity of a point of the ground in a frame's camera.

        Args:
            point: column and row in this view [px].
            camera: of the frame.
            ground_y: height of the ground [scene unit].

        Returns:
            1 / depth, <= 0 above the horizon [1 / scene unit].
        """
        ...


class StaticView(Struct, frozen=True):
    """Reference view of a static camera: the frame itself.

    Attributes:
        size: columns and rows [px].
    """

    size: tuple[int, int]

    @property
    def lowres_size(self) -> tuple[int, int]:
        """See `ReferenceView`."""
        return lowres_size(*self.size)

    def downsampled(self, picture: Picture) -> Float32:
        """Roots of light of a frame at low resolution (h, w, 3)."""
        return sqrt_light(picture.downsample(*self.lowres_size))

    def warp_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """See `ReferenceView`."""
        return self.downsampled(picture)

    def register_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """See `ReferenceView`."""
        return self.downsampled(picture)

    def render_background(self, model: BackgroundModel, camera: Camera) -> BackgroundModel:
        """See `ReferenceView`."""
        return model

    def register_box(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        return sqrt_light(picture.linear(box))

    def box_in_reference(self, box: Box, camera: Camera) -> Box:
        """See `ReferenceView`."""
        return box

    def box_in_frame(self, box: Box, camera: Camera) -> Box:
        """See `ReferenceView`."""
        return box

    def lowres_to_frame(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        large = cv2.resize(values, self.size, interpolation=cv2.INTER_LINEAR)
        return np.asarray(large[box.slices_in(Box(0, 0, *self.size))], np.float32)

    def box_to_frame(self, values: Float32, source: Box, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        return values[box.slices_in(source)]

    def ground_disparity(
        self, point: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """See `ReferenceView`."""
        return ground_disparity_at(point, camera, ground_y)


def ground_disparity_at(point: tuple[float, float], camera: Camera, ground_y: float) -> float:
    """Disparity of the ground at a pixel of a camera [1 / scene unit]."""
    x, y = math.floor(point[0]), math.floor(point[1])
    return float(camera.cropped(Box(x, y, x + 1, y + 1)).plane_disparity(ground_y)[0, 0])
