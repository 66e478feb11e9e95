"""The picture into which a shot's frames are laid, so that its background stands still in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.effects.foreground.background import SmallBackground, root, small_size
from nlens_video.scene.camera import Camera


class Canvas(Protocol):
    """Where frames are laid."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows, at the frame's scale [px]."""
        ...

    @property
    def small_size(self) -> tuple[int, int]:
        """Columns and rows at which things that move are searched [px]."""
        ...

    def small(self, picture: Picture, camera: Camera) -> Float32:
        """Roots of light of a frame, laid at the small size (h, w, 3); NaN beyond it.

        What moves keeps its shape; what stands still may shift, as `background` tells.
        """
        ...

    def still(self, picture: Picture, camera: Camera) -> Float32:
        """The same, laid so that what stands still does not shift; NaN also where it is hidden."""
        ...

    def background(self, small: SmallBackground, camera: Camera) -> SmallBackground:
        """What `small` would show of a frame if nothing moved, of the shot's background."""
        ...

    def part(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """Roots of light of a box of the canvas (h, w, 3); NaN beyond the frame."""
        ...

    def reached(self, box: Box, camera: Camera) -> Box:
        """The box of the canvas around a box of a frame."""
        ...

    def seen(self, box: Box, camera: Camera) -> Box:
        """The box of a frame around a box of the canvas."""
        ...

    def from_small(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """What a box of a frame shows of values on the small canvas."""
        ...

    def from_part(self, values: Float32, held: Box, camera: Camera, box: Box) -> Float32:
        """What a box of a frame shows of values on a box of the canvas; NaN beyond it."""
        ...

    def ground_disparity(
        self, place: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """Disparity of the ground for a frame's camera, where the canvas shows it.

        Args:
            place: column and row on the canvas [px].
            camera: of the frame.
            ground_y: height of the ground [scene unit].

        Returns:
            1 / depth, <= 0 above the horizon [1 / scene unit].
        """
        ...


@dataclass(frozen=True, slots=True)
class StillCanvas:
    """The frame of a still camera.

    Attributes:
        size: columns and rows [px].
    """

    size: tuple[int, int]

    @property
    def small_size(self) -> tuple[int, int]:
        """As of `Canvas`."""
        return small_size(*self.size)

    def shrunk(self, picture: Picture) -> Float32:
        """Roots of light of a frame at the small size (h, w, 3)."""
        return root(picture.downsample(*self.small_size))

    def small(self, picture: Picture, camera: Camera) -> Float32:
        """As of `Canvas`."""
        return self.shrunk(picture)

    def still(self, picture: Picture, camera: Camera) -> Float32:
        """As of `Canvas`."""
        return self.shrunk(picture)

    def background(self, small: SmallBackground, camera: Camera) -> SmallBackground:
        """As of `Canvas`."""
        return small

    def part(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        return root(picture.linear(box))

    def reached(self, box: Box, camera: Camera) -> Box:
        """As of `Canvas`."""
        return box

    def seen(self, box: Box, camera: Camera) -> Box:
        """As of `Canvas`."""
        return box

    def from_small(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        large = cv2.resize(values, self.size, interpolation=cv2.INTER_LINEAR)
        return np.asarray(large[box.slices_in(Box(0, 0, *self.size))], np.float32)

    def from_part(self, values: Float32, held: Box, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        return values[box.slices_in(held)]

    def ground_disparity(
        self, place: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """As of `Canvas`."""
        return ground_disparity_at(place, camera, ground_y)


def ground_disparity_at(place: tuple[float, float], camera: Camera, ground_y: float) -> float:
    """Disparity of the ground at a place of a camera's frame [1 / scene unit]."""
    x, y = math.floor(place[0]), math.floor(place[1])
    return float(camera.cropped(Box(x, y, x + 1, y + 1)).plane_disparity(ground_y)[0, 0])
