"""What a body hides from the ground before a camera: projections from many points of light."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from nlens_video.frames import Float64
from nlens_video.kernels.cast import count_covered, new_counts
from nlens_video.kernels.cast_veils import count_veiled, new_veiled
from nlens_video.scene.camera import Camera
from nlens_video.scene.casters import Opacity
from nlens_video.scene.illumination import Lamp
from nlens_video.scene.solid import Solid

_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_R2 = (0.7548776662466927, 0.5698402909980532)  # of Roberts' low-discrepancy sequence
_COARSE = 4  # contact darkening is smooth: one pixel in so many each way is enough [px]
_FAINT = 0.03  # a share below which nobody sees it: bounds how far contact darkening reaches
_LOWEST = 0.93  # squared sine off the vertical beyond which light from around is not followed


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """A body over a ground before a camera.

    Attributes:
        solid: the body, above the ground.
        camera: the camera.
        ground_y: height of the ground plane [scene unit].
        veils: what of the body is not opaque, above the ground, and how much light it stops.
    """

    solid: Solid
    camera: Camera
    ground_y: float
    veils: tuple[tuple[Solid, Opacity], ...] = ()

    @property
    def empty(self) -> bool:
        """Whether nothing stands on it."""
        return not any(len(body.faces) for body in self._bodies)

    @property
    def _bodies(self) -> tuple[Solid, ...]:
        return (self.solid, *(veil for veil, _ in self.veils))

    @property
    def size(self) -> tuple[int, int, int]:
        """Shape of a picture."""
        return (self.camera.height, self.camera.width, 3)

    @property
    def middle(self) -> Float64:
        """Middle of the body's bounds (3,)."""
        seen = np.concatenate([body.used for body in self._bodies])
        return np.asarray(0.5 * (seen.min(axis=0) + seen.max(axis=0)))

    @property
    def base(self) -> Float64:
        """The ground below the middle (3,)."""
        return self.middle * (1.0, 0.0, 1.0) + (0.0, self.ground_y, 0.0)

    @property
    def ground(self) -> Float64:
        """Ground points (h, w, 3) of the pixels; any point where the plane is not seen."""
        camera = self.camera
        disparity = camera.plane_disparity(self.ground_y)
        depth = 1.0 / np.where(disparity > 0.0, disparity, 1.0)
        x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
        y = -(np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], -1.0), axis=-1)
        rotation, eye = camera.world_from_camera[:3, :3], camera.world_from_camera[:3, 3]
        return np.asarray(depth[..., None] * (rays @ rotation.T) + eye)

    def hidden(self, lamp: Lamp, points: int) -> Float64:
        """Share (h, w) of a lamp that the body hides, as so many points of it tell [1]."""
        return self._counts(_points(lamp, self.middle, points)) / points

    def occlusion(self, directions: int) -> Float64:
        """Share (h, w) of the light from above, weighted by its cosine, that the body hides [1]."""
        number = np.arange(directions)
        squared_sine = (number + 0.5) / directions  # of the angle off the vertical
        turn, sine = number * _GOLDEN, np.sqrt(squared_sine)
        up = np.sqrt(1.0 - squared_sine)
        toward = np.stack([sine * np.cos(turn), up, sine * np.sin(turn), 0.0 * up], axis=1)
        small = replace(self, camera=_coarser(self.camera))
        counts = small._counts(toward[squared_sine <= _LOWEST])
        faint = max(_FAINT, min(1.0 / directions, 0.5))
        coarse = np.maximum(counts / directions - faint, 0.0).astype(np.float32) / (1.0 - faint)
        rows, columns = (size * _COARSE for size in coarse.shape)
        fine = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
        return fine[: self.camera.height, : self.camera.width].astype(np.float64)

    def _counts(self, lights: Float64) -> Float64:
        """How many of the lights (N, 4) the body hides from each pixel's ground (h, w).

        A light is a point (x, y, z, 1) or the direction towards one far away, (x, y, z, 0). What
        is not opaque hides a part of one.
        """
        counts = new_counts(self.camera.height, self.camera.width)
        veiled = new_veiled(self.camera.height, self.camera.width)
        for call, light in enumerate(lights, start=1):
            if light[1] <= light[3] * self.ground_y:
                continue
            pixels = _pixels_from_world(self.camera) @ _flattened(light, self.ground_y)
            at = ((call * _R2[0]) % 1.0, (call * _R2[1]) % 1.0)
            solid = self.solid if light[3] == 0.0 else self.solid.below(light[1])
            points = solid.points @ pixels[:, :3].T + pixels[:, 3]
            count_covered(counts, points, solid.faces, call, at)
            for whole, opacity in self.veils:
                veil = whole if light[3] == 0.0 else whole.below(light[1])
                points = veil.points @ pixels[:, :3].T + pixels[:, 3]
                surface = np.ascontiguousarray(veil.vertices[:, 3:])
                texture = (opacity.alpha, opacity.wrap, opacity.cutoff)
                count_veiled(veiled, counts, points, surface, veil.faces, texture, call, at)
        return np.asarray(counts[0] + veiled.taken, dtype=np.float64)


def _coarser(camera: Camera) -> Camera:
    """The same view on fewer pixels, the last ones perhaps beyond the frame."""
    step = _COARSE
    return replace(
        camera, fx=camera.fx / step, fy=camera.fy / step, cx=camera.cx / step, cy=camera.cy / step,
        width=-(-camera.width // step), height=-(-camera.height // step),
    )  # fmt: skip


def _points(lamp: Lamp, middle: Float64, count: int) -> Float64:
    """Points (N, 4) of a lamp's disc as seen from the object; w = 0 for a lamp far away."""
    posed = lamp.posed
    far = posed.light.kind == "directional"
    toward = -posed.direction if far else posed.position - middle
    distance = float(np.linalg.norm(toward))
    axis = toward / max(distance, np.finfo(np.float64).tiny)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    number = np.arange(count)
    radius = math.tan(0.5 * lamp.diameter) * distance * np.sqrt((number + 0.5) / count)
    aside = np.cos(number * _GOLDEN)[:, None] * first + np.sin(number * _GOLDEN)[:, None] * second
    middle_of_lamp = toward if far else posed.position
    places = middle_of_lamp + radius[:, None] * aside
    return np.column_stack([places, np.full(count, 0.0 if far else 1.0)])


def _flattened(light: Float64, ground_y: float) -> Float64:
    """Projection (4, 4) of homogeneous points on the plane, away from a light (4,).

    Sign-true for points that lie lower than the light: the last coordinate is positive there.
    """
    plane = np.array([0.0, 1.0, 0.0, -ground_y])
    return np.asarray((plane @ light) * np.eye(4) - np.outer(light, plane))


def _pixels_from_world(camera: Camera) -> Float64:
    """Homogeneous pixel positions (3, 4), the last coordinate the depth."""
    intrinsics = np.array(
        [[camera.fx, 0.0, -camera.cx], [0.0, -camera.fy, -camera.cy], [0.0, 0.0, -1.0]]
    )
    return np.asarray(intrinsics @ camera.camera_from_world[:3])
