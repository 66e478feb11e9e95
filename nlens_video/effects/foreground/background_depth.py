"""Depth of the background, from the parallax of a camera that travels.

Frames are warped until they have one orientation and differ by their camera's place only. Of a
number of depths each pixel takes the one at which they agree best: a plane sweep (Collins 1996).
Targets that move are in the minority at each pixel, and the median leaves them out. The plane of
the ground is known: nothing lies behind it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.foreground.frame_sampler import (
    CODE_SCALE,
    MIN_CHANGE,
    UNKNOWN_CODE,
    Codes,
    FrameSampler,
    upper_median,
)
from nlens_video.effects.foreground.reference_view import PixelMap
from nlens_video.kernels.channels import channel_max
from nlens_video.scene.camera import Camera

_DEPTH_STEP_PX = 0.5  # largest shift of a frame from one depth to the next [px]
_MAX_DEPTHS, _MAX_VIEWS = 96, 15
_MAX_DISPARITY = 2.0  # largest disparity that is tried, by that of the object's contact [1]
_OCCLUSION_PX = 1.0  # parallax between a surface and the one that occludes it [px]
_GUIDE_RADIUS_PX = 4  # radius of the guided filter that aggregates the matching cost [px]
_GUIDE_EPSILON = 1e-4  # its regularisation: variance of roots of light within a surface [1]
_MAX_COST = 1.5 * MIN_CHANGE  # truncation of the cost of a frame: a moving target costs no more [1]
_UNKNOWN_COST = 0.5  # cost of a frame that does not show the pixel, by `_MAX_COST` [1]
_GROUND_BIAS = 0.9  # factor on the cost of the ground, which other depths must undercut [1]


class BackgroundDepth(Struct, frozen=True, kw_only=True):
    """Depth of the background in the view of one camera.

    Attributes:
        camera: at low resolution.
        disparity: 1 / depth along its axis (h, w) [1 / scene unit].
    """

    camera: Camera
    disparity: Float32

    def project_to(self, eye: Float64) -> PixelMap:
        """Projection of each pixel to a camera of the same orientation at another place (3,)."""
        return _reproject(self.camera, self.disparity, _baseline(self.camera, eye))[:2]

    def forward_map(self, eye: Float64) -> PixelMap:
        """Projection of each pixel to a camera of the same orientation, with occlusion.

        Args:
            eye: where that camera stands (3,) [scene unit].

        Returns:
            Its pixels; -1e6 where a nearer part of the background occludes the pixel.
        """
        baseline = _baseline(self.camera, eye)
        columns, rows, disparity = _reproject(self.camera, self.disparity, baseline)
        nearest = self._z_buffer(columns, rows, disparity)
        height, width = nearest.shape
        x = np.clip(np.rint(columns), 0, width - 1).astype(np.intp)
        y = np.clip(np.rint(rows), 0, height - 1).astype(np.intp)
        occluded = (nearest[y, x] - disparity) * self._parallax(baseline) > _OCCLUSION_PX
        columns[occluded] = rows[occluded] = np.float32(-1e6)
        return columns, rows

    def inverse_map(self, eye: Float64) -> tuple[PixelMap, Bool]:
        """Pixels of this view that show what a camera of the same orientation sees.

        Args:
            eye: where that camera stands (3,) [scene unit].

        Returns:
            This view's pixels, for each pixel of that camera; and where (h, w) a nearer part of the
            background occludes what that camera sees.
        """
        baseline = _baseline(self.camera, eye)
        columns, rows, there = _reproject(self.camera, self.disparity, baseline)
        disparity = _fill_holes(self._z_buffer(columns, rows, there))
        columns, rows, here = _reproject(self.camera, disparity, -baseline)
        shown = cv2.remap(
            self.disparity, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
        )
        occluded = np.abs(shown - here) * self._parallax(baseline) > _OCCLUSION_PX
        return (columns, rows), np.asarray(occluded)

    def _parallax(self, baseline: Float64) -> float:
        """Parallax of a disparity of 1 [px scene unit]."""
        return float(self.camera.fx * np.abs(baseline).max())

    def _z_buffer(self, columns: Float32, rows: Float32, disparity: Float32) -> Float32:
        """Largest disparity that is projected to each pixel (h, w); -1 inside large holes."""
        height, width = disparity.shape
        x, y = np.rint(columns), np.rint(rows)
        inside = np.flatnonzero((x >= 0) & (x < width) & (y >= 0) & (y < height))
        at = (y.ravel()[inside] * width + x.ravel()[inside]).astype(np.intp)
        values = disparity.ravel()[inside]
        order = np.argsort(values, kind="stable")
        found = np.full(height * width, -1.0, np.float32)
        found[at[order]] = values[order]
        buffer = found.reshape(height, width)
        near = cv2.dilate(buffer, np.ones((3, 3), np.uint8))
        buffer = np.where(buffer < 0.0, near, buffer)
        return np.asarray(cv2.medianBlur(buffer, 3), np.float32)


def _fill_holes(disparity: Float32) -> Float32:
    """Fill pixels below 0 with the farthest disparity at the hole's border."""
    unknown = np.float32(1e9)
    filled = np.where(disparity < 0.0, unknown, disparity)
    while (empty := filled >= unknown).any():
        if empty.all():
            return np.zeros_like(disparity)
        filled = np.where(empty, cv2.erode(filled, np.ones((3, 3), np.uint8)), filled)
    return np.asarray(filled, np.float32)


def _baseline(camera: Camera, eye: Float64) -> Float64:
    """From another place (3,) to a camera's, right, up and back of it (3,) [scene unit]."""
    pose = camera.world_from_camera
    return np.asarray(pose[:3, :3].T @ (pose[:3, 3] - eye))


def _reproject(
    camera: Camera, disparity: Float32, baseline: Float64
) -> tuple[Float32, Float32, Float32]:
    """Columns, rows and disparity (h, w) of a camera's pixels, as seen from another place."""
    right, up, back = (np.float32(one) for one in baseline)
    x = ((np.arange(camera.width) + 0.5 - camera.cx) / camera.fx).astype(np.float32)[None, :]
    y = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy).astype(np.float32)[:, None]
    depth_ratio = np.maximum(np.float32(1.0) - disparity * back, np.float32(1e-3))
    half = np.float32(0.5)
    columns = (x + disparity * right) / depth_ratio * np.float32(camera.fx)
    columns = columns + np.float32(camera.cx) - half
    rows = (y - disparity * up) / depth_ratio * np.float32(camera.fy) + np.float32(camera.cy) - half
    return columns, rows, disparity / depth_ratio


@dataclass(slots=True)
class PlaneSweep:
    """A bounded sample of frames of one orientation, from which the depth is estimated."""

    _sampler: FrameSampler = field(default_factory=lambda: FrameSampler(max_frames=_MAX_VIEWS))
    _eyes: list[Float64] = field(default_factory=list)

    def add(self, roots: Float32, eye: Float64) -> None:
        """Add the next frame.

        Args:
            roots: square root of its light (h, w, 3); NaN beyond it.
            eye: where its camera stood (3,) [scene unit].
        """
        if self._sampler.takes_next:
            self._eyes.append(eye)
        self._sampler.add(roots)
        if len(self._eyes) > self._sampler.max_frames:
            del self._eyes[1::2]

    @property
    def central_eye(self) -> Float64:
        """The camera position (3,) nearest to the centre of all of them."""
        eyes = np.array(self._eyes)
        away = np.linalg.norm(eyes - 0.5 * (eyes.min(axis=0) + eyes.max(axis=0)), axis=1)
        return self._eyes[int(np.argmin(away))]

    def disparity(self, camera: Camera, contact: Float64) -> Float32:
        """1 / depth of the background (h, w) [1 / scene unit].

        Args:
            camera: the view.
            contact: where the object stands on the ground (3,).
        """
        depth = -float(camera.to_camera(contact[None])[0, 2])
        nearest = 1.0 / max(depth, 1e-6)
        return sweep_disparity(self._sampler.frames, self._eyes, camera, float(contact[1]), nearest)


def sweep_disparity(
    frames: Sequence[Codes], eyes: Sequence[Float64], camera: Camera, ground_y: float,
    nearest: float,
) -> Float32:  # fmt: skip
    """1 / depth (h, w) of what frames of one orientation show, by a plane sweep [1 / scene unit].

    Args:
        frames: codes of the roots of light (h, w, 3), as of `FrameSampler.frames`.
        eyes: where the camera of each stood (3,) [scene unit].
        camera: the view; one of those cameras.
        ground_y: height of the ground [scene unit].
        nearest: disparity of the object's contact with the ground [1 / scene unit].
    """
    baselines = [_baseline(camera, eye) for eye in eyes]
    parallax = camera.fx * max(float(np.abs(one).max()) for one in baselines)
    most = _MAX_DISPARITY * nearest
    count = min(_MAX_DEPTHS, max(2, math.ceil(most * parallax / _DEPTH_STEP_PX) + 1))
    ground = np.maximum(camera.plane_disparity(ground_y), 0.0).astype(np.float32)
    guide = _guide_image(frames, eyes, camera)
    tolerance = np.float32(0.5 * most / (count - 1))
    planes = [np.full(ground.shape, one, np.float32) for one in np.linspace(0.0, most, count)]
    found = ground.copy()
    best = _matching_cost(frames, baselines, camera, ground, guide)
    best *= np.float32(_GROUND_BIAS)
    for plane in planes:
        cost = _matching_cost(frames, baselines, camera, plane, guide)
        better = (cost < best) & (plane > ground + tolerance)
        found[better] = plane[better]
        best[better] = cost[better]
    return np.asarray(cv2.medianBlur(found, 5), np.float32)


def _guide_image(frames: Sequence[Codes], eyes: Sequence[Float64], camera: Camera) -> Float32:
    """The frame from nearest to the view; its edges guide the aggregation of the cost."""
    away = [float(np.linalg.norm(eye - camera.world_from_camera[:3, 3])) for eye in eyes]
    codes = frames[int(np.argmin(away))]
    known = np.where(codes == UNKNOWN_CODE, np.uint16(0), codes)
    return known.astype(np.float32) / np.float32(CODE_SCALE)


def _matching_cost(
    frames: Sequence[Codes], baselines: Sequence[Float64], camera: Camera, disparity: Float32,
    guide: Float32,
) -> Float32:  # fmt: skip
    """Mean absolute deviation from their median of frames warped by a disparity (h, w) [1]."""
    low = np.ones(disparity.shape, np.bool_)
    warped: list[tuple[Codes, Bool]] = []
    for codes, baseline in zip(frames, baselines, strict=True):
        columns, rows, _ = _reproject(camera, disparity, baseline)
        one = np.asarray(
            cv2.remap(
                codes, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
                borderValue=(65535, 65535, 65535),
            ),
            np.uint16,
        )  # fmt: skip
        unknown = one[..., 0] > 4 * CODE_SCALE
        one[unknown & low] = 0  # the smallest and the greatest code by turns leave the median
        one[unknown & ~low] = UNKNOWN_CODE
        low ^= unknown
        warped.append((one, unknown))
    median = upper_median([one for one, _ in warped])
    limit = np.uint16(_MAX_COST * CODE_SCALE)
    of_unknown = np.uint16(_UNKNOWN_COST * limit)  # at no cost, depths that few frames show win
    total = np.zeros(disparity.shape, np.float32)
    for one, unknown in warped:
        deviation = channel_max(np.maximum(one, median) - np.minimum(one, median))
        total += np.where(unknown, of_unknown, np.minimum(deviation, limit))
    total /= np.float32(len(warped) * CODE_SCALE)
    filtered = cv2.ximgproc.guidedFilter(guide, total, _GUIDE_RADIUS_PX, _GUIDE_EPSILON)
    return np.asarray(filtered, np.float32)
