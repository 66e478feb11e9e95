"""The canvas of a camera that travels: what stands still is laid by its depth.

What moves is looked for in the frame as it is, only turned: laid by the depth of what is behind it,
it would be torn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Picture
from nlens_video.effects.foreground.background import SmallBackground, root
from nlens_video.effects.foreground.relief import Relief
from nlens_video.effects.foreground.turned_canvas import (
    NOWHERE,
    Places,
    TurnedCanvas,
    around,
    laid,
)
from nlens_video.scene.camera import Camera

_HALF = np.float32(0.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class TravelledCanvas:
    """The picture of one camera, for the frames of another that turns and travels.

    Attributes:
        turned: it looks the way of that camera, from wherever a frame's camera stands.
        relief: depth of the background, from where the canvas' camera stands.
    """

    turned: TurnedCanvas
    relief: Relief

    @classmethod
    def of(cls, turned: TurnedCanvas, disparity: Float32) -> TravelledCanvas:
        """The canvas of a background's disparity (h, w) at its small size [1 / scene unit]."""
        camera = turned.camera.resized(*turned.small_size)
        return cls(turned=turned, relief=Relief(camera=camera, disparity=disparity))

    @property
    def size(self) -> tuple[int, int]:
        """As of `Canvas`."""
        return self.turned.size

    @property
    def small_size(self) -> tuple[int, int]:
        """As of `Canvas`."""
        return self.turned.small_size

    def small(self, picture: Picture, camera: Camera) -> Float32:
        """As of `Canvas`."""
        return self._there(camera).small(picture, camera)

    def still(self, picture: Picture, camera: Camera) -> Float32:
        """As of `Canvas`."""
        return laid(self.small(picture, camera), self._laid_from(camera))

    def background(self, small: SmallBackground, camera: Camera) -> SmallBackground:
        """As of `Canvas`."""
        places, hidden = self._seen_from(camera)
        roots, noise = (
            cv2.remap(one, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for one in (small.roots, small.noise)
        )
        seen = cv2.remap(
            small.seen.astype(np.float32), *places, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
        )  # fmt: skip
        return replace(
            small, roots=np.asarray(roots, np.float32), noise=np.asarray(noise, np.float32),
            seen=np.asarray((seen > 0.99) & ~hidden),
        )  # fmt: skip

    def part(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        columns, rows = self._there(camera).shown(self._large(camera, box), camera)
        held = around(columns, rows).expanded(2).intersection(Box(0, 0, *self.turned.frame))
        if held.empty:
            return np.full((*box.shape, 3), np.nan, np.float32)
        moved = columns - np.float32(held.x0), rows - np.float32(held.y0)
        return laid(root(picture.linear(held)), moved)

    def reached(self, box: Box, camera: Camera) -> Box:
        """As of `Canvas`."""
        return self._there(camera).reached(box, camera)

    def seen(self, box: Box, camera: Camera) -> Box:
        """As of `Canvas`."""
        (across, down), (x, y) = self.size, self.small_size
        small = Box(
            math.floor(box.x0 * x / across), math.floor(box.y0 * y / down),
            math.ceil(box.x1 * x / across), math.ceil(box.y1 * y / down),
        ).intersection(Box(0, 0, x, y))  # fmt: skip
        at = small.expanded(1).intersection(Box(0, 0, x, y)).slices_in(Box(0, 0, x, y))
        columns, rows = self.relief.moved_to(camera.world_from_camera[:3, 3])
        places = self._there(camera).shown(self._by_large((columns[at], rows[at])), camera)
        return around(*places).intersection(Box(0, 0, *self.turned.frame))

    def from_small(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        return self._there(camera).from_small(values, camera, box)

    def from_part(self, values: Float32, held: Box, camera: Camera, box: Box) -> Float32:
        """As of `Canvas`."""
        places, hidden = self._seen_from(camera)
        columns, rows = self._by_small(self._there(camera).frame_places(camera, box))
        columns, rows = _between(places, hidden, columns, rows)
        columns, rows = self._by_large((columns, rows))
        return laid(values, (columns - np.float32(held.x0), rows - np.float32(held.y0)))

    def ground_disparity(
        self, place: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """As of `Canvas`."""
        return self._there(camera).ground_disparity(place, camera, ground_y)

    def _there(self, camera: Camera) -> TurnedCanvas:
        return self.turned.from_eye(camera.world_from_camera[:3, 3])

    def _laid_from(self, camera: Camera) -> Places:
        return self.relief.laid_from(camera.world_from_camera[:3, 3])

    def _seen_from(self, camera: Camera) -> tuple[Places, Bool]:
        return self.relief.seen_from(camera.world_from_camera[:3, 3])

    def _large(self, camera: Camera, box: Box) -> Places:
        """Where the turned canvas shows a box of this one, as a frame's camera sees it."""
        columns, rows = np.meshgrid(
            np.arange(box.x0, box.x1, dtype=np.float32), np.arange(box.y0, box.y1, dtype=np.float32)
        )
        places = self._laid_from(camera)
        nowhere = places[0] <= NOWHERE
        return self._by_large(_between(places, nowhere, *self._by_small((columns, rows))))

    def _by_small(self, places: Places) -> Places:
        x, y = self._scale
        return (places[0] + _HALF) / x - _HALF, (places[1] + _HALF) / y - _HALF

    def _by_large(self, places: Places) -> Places:
        x, y = self._scale
        return (places[0] + _HALF) * x - _HALF, (places[1] + _HALF) * y - _HALF

    @property
    def _scale(self) -> tuple[np.float32, np.float32]:
        (across, down), (x, y) = self.size, self.small_size
        return np.float32(across / x), np.float32(down / y)


def _between(places: Places, hidden: Bool, columns: Float32, rows: Float32) -> Places:
    """What a map of places holds between its pixels; nowhere beside what is hidden."""
    near = cv2.remap(
        hidden.astype(np.float32), columns, rows, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=(1.0,),
    )  # fmt: skip
    found = []
    for one in places:
        at = cv2.remap(one, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        found.append(np.where(near > 0.0, np.float32(NOWHERE), np.asarray(at, np.float32)))
    return found[0], found[1]
