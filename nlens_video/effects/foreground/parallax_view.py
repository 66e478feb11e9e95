"""Reference view of a camera that travels: the background is warped by its depth.

Motion is detected before that warp, in the frame with its camera's rotation removed: warped by the
depth of the background behind it, a target would be torn.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, Box, Float32, Picture
from nlens_video.effects.foreground.background import BackgroundModel
from nlens_video.effects.foreground.background_depth import BackgroundDepth
from nlens_video.effects.foreground.reference_view import PixelMap
from nlens_video.effects.foreground.rotation_view import (
    OUT_OF_VIEW,
    RotationView,
    bounding_box,
    warp,
    warp_picture,
)
from nlens_video.scene.camera import Camera

_HALF = np.float32(0.5)


class ParallaxView(Struct, frozen=True, kw_only=True):
    """The view of one virtual camera, for frames of a camera that rotates and travels.

    Attributes:
        rotation: the virtual camera's view.
        depth: of the background in that view.
    """

    rotation: RotationView
    depth: BackgroundDepth

    @classmethod
    def from_disparity(cls, rotation: RotationView, disparity: Float32) -> ParallaxView:
        """The view with a background's disparity (h, w) at low resolution [1 / scene unit]."""
        camera = rotation.camera.resized(*rotation.lowres_size)
        return cls(rotation=rotation, depth=BackgroundDepth(camera=camera, disparity=disparity))

    @property
    def size(self) -> tuple[int, int]:
        """See `ReferenceView`."""
        return self.rotation.size

    @property
    def lowres_size(self) -> tuple[int, int]:
        """See `ReferenceView`."""
        return self.rotation.lowres_size

    def warp_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """See `ReferenceView`."""
        return self._rotation_at(camera).warp_lowres(picture, camera)

    def register_lowres(self, picture: Picture, camera: Camera) -> Float32:
        """See `ReferenceView`."""
        return warp(self.warp_lowres(picture, camera), self._forward_map(camera))

    def render_background(self, model: BackgroundModel, camera: Camera) -> BackgroundModel:
        """See `ReferenceView`."""
        pixels, occluded = self._inverse_map(camera)
        roots, noise = (
            cv2.remap(one, *pixels, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for one in (model.roots, model.noise)
        )
        seen = cv2.remap(
            model.seen.astype(np.float32), *pixels, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
        )  # fmt: skip
        return replace(
            model, roots=np.asarray(roots, np.float32), noise=np.asarray(noise, np.float32),
            seen=np.asarray((seen > 0.99) & ~occluded),
        )  # fmt: skip

    def register_box(self, picture: Picture, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        pixels = self._registration_map(camera, box)
        columns, rows = self._rotation_at(camera).project_to_frame(pixels, camera)
        return warp_picture(picture, (columns, rows), self.rotation.frame_size)

    def box_in_reference(self, box: Box, camera: Camera) -> Box:
        """See `ReferenceView`."""
        return self._rotation_at(camera).box_in_reference(box, camera)

    def box_in_frame(self, box: Box, camera: Camera) -> Box:
        """See `ReferenceView`."""
        (across, down), (x, y) = self.size, self.lowres_size
        lowres = Box(
            math.floor(box.x0 * x / across), math.floor(box.y0 * y / down),
            math.ceil(box.x1 * x / across), math.ceil(box.y1 * y / down),
        ).intersection(Box(0, 0, x, y))  # fmt: skip
        crop = lowres.expanded(1).intersection(Box(0, 0, x, y)).slices_in(Box(0, 0, x, y))
        columns, rows = self.depth.project_to(camera.world_from_camera[:3, 3])
        pixels = self._to_full_resolution((columns[crop], rows[crop]))
        pixels = self._rotation_at(camera).project_to_frame(pixels, camera)
        return bounding_box(*pixels).intersection(Box(0, 0, *self.rotation.frame_size))

    def lowres_to_frame(self, values: Float32, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        return self._rotation_at(camera).lowres_to_frame(values, camera, box)

    def box_to_frame(self, values: Float32, source: Box, camera: Camera, box: Box) -> Float32:
        """See `ReferenceView`."""
        pixels, occluded = self._inverse_map(camera)
        columns, rows = self._to_low_resolution(
            self._rotation_at(camera).map_to_reference(camera, box)
        )
        columns, rows = _sample_map(pixels, occluded, columns, rows)
        columns, rows = self._to_full_resolution((columns, rows))
        return warp(values, (columns - np.float32(source.x0), rows - np.float32(source.y0)))

    def ground_disparity(
        self, point: tuple[float, float], camera: Camera, ground_y: float
    ) -> float:
        """See `ReferenceView`."""
        return self._rotation_at(camera).ground_disparity(point, camera, ground_y)

    def _rotation_at(self, camera: Camera) -> RotationView:
        """The view of the virtual camera's orientation from where a frame's camera is."""
        return self.rotation.at_eye(camera.world_from_camera[:3, 3])

    def _forward_map(self, camera: Camera) -> PixelMap:
        return self.depth.forward_map(camera.world_from_camera[:3, 3])

    def _inverse_map(self, camera: Camera) -> tuple[PixelMap, Bool]:
        return self.depth.inverse_map(camera.world_from_camera[:3, 3])

    def _registration_map(self, camera: Camera, box: Box) -> PixelMap:
        """Pixels of `_rotation_at` that show the background at the pixels of a box of this view."""
        columns, rows = np.meshgrid(
            np.arange(box.x0, box.x1, dtype=np.float32), np.arange(box.y0, box.y1, dtype=np.float32)
        )
        pixels = self._forward_map(camera)
        occluded = pixels[0] <= OUT_OF_VIEW
        at = self._to_low_resolution((columns, rows))
        return self._to_full_resolution(_sample_map(pixels, occluded, *at))

    def _to_low_resolution(self, pixels: PixelMap) -> PixelMap:
        x, y = self._scale
        return (pixels[0] + _HALF) / x - _HALF, (pixels[1] + _HALF) / y - _HALF

    def _to_full_resolution(self, pixels: PixelMap) -> PixelMap:
        x, y = self._scale
        return (pixels[0] + _HALF) * x - _HALF, (pixels[1] + _HALF) * y - _HALF

    @property
    def _scale(self) -> tuple[np.float32, np.float32]:
        """Pixels at full resolution by those at low resolution [1]."""
        (across, down), (x, y) = self.size, self.lowres_size
        return np.float32(across / x), np.float32(down / y)


def _sample_map(pixels: PixelMap, occluded: Bool, columns: Float32, rows: Float32) -> PixelMap:
    """A map of pixels, interpolated at columns and rows; out of view next to occluded pixels."""
    near = cv2.remap(
        occluded.astype(np.float32), columns, rows, cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=(1.0,),
    )  # fmt: skip
    found = []
    for one in pixels:
        at = cv2.remap(one, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        found.append(np.where(near > 0.0, np.float32(OUT_OF_VIEW), np.asarray(at, np.float32)))
    return found[0], found[1]
