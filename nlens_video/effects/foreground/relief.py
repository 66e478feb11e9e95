"""The depth of a shot's background, which a camera that travels shows by how it shifts.

Pictures of the shot are turned until they look the way of one of them, and differ by where their
camera stands only. Of a number of depths each pixel takes the one at which they agree best, as in
plane sweeping (Collins 1996); what moves is in the minority at each pixel, and is left out by the
median. The plane of the ground is known beforehand: nothing lies behind it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.effects.foreground.reservoir import (
    MOVED,
    Codes,
    Reservoir,
    largest,
    middle,
)
from nlens_video.scene.camera import Camera

Places = tuple[Float32, Float32]
"""Columns and rows (h, w), for `cv2.remap`."""
_STEP_PX = 0.5  # by which the farthest pictures shift from one depth to the next
_MOST_DEPTHS, _MOST_VIEWS = 96, 15
_NEAREST = 2.0  # disparity up to which depths are tried, by that of the object's contact
_APART_PX = 1.0  # by which what hides something shifts against it
_WINDOW = 4  # pixels around one whose pictures are compared with its own
_SMOOTHEST = 1e-4  # variance of roots of light below which a window is one surface
_MOST_OFF = 1.5 * MOVED  # that counts, of a root of light: what moves does not count more
_UNSEEN = 0.5  # of that, which a picture counts that does not show a pixel
_FLAT = 0.9  # of the cost of the ground, below which another depth must lie [1]
_CODES = 16383.0
_HIDDEN = np.uint16(65535)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relief:
    """The depth of a background from one place.

    Attributes:
        camera: at that place, of the small size.
        disparity: 1 / depth along its axis (h, w) [1 / scene unit].
    """

    camera: Camera
    disparity: Float32

    def moved_to(self, eye: Float64) -> Places:
        """Where a camera that looks the same way from elsewhere (3,) would show each pixel."""
        return _shifted(self.camera, self.disparity, _shift(self.camera, eye))[:2]

    def laid_from(self, eye: Float64) -> Places:
        """Where a camera that looks the same way from elsewhere shows each pixel.

        Args:
            eye: where it stands (3,) [scene unit].

        Returns:
            Places; -1e6 where it does not show it, since something nearer hides it.
        """
        shift = _shift(self.camera, eye)
        columns, rows, disparity = _shifted(self.camera, self.disparity, shift)
        nearest = self._nearest(columns, rows, disparity)
        height, width = nearest.shape
        x = np.clip(np.rint(columns), 0, width - 1).astype(np.intp)
        y = np.clip(np.rint(rows), 0, height - 1).astype(np.intp)
        hidden = (nearest[y, x] - disparity) * self._pixels(shift) > _APART_PX
        columns[hidden] = rows[hidden] = np.float32(-1e6)
        return columns, rows

    def seen_from(self, eye: Float64) -> tuple[Places, Bool]:
        """Where this camera shows what one sees that looks the same way from elsewhere.

        Args:
            eye: where it stands (3,) [scene unit].

        Returns:
            Places; and where (h, w) it does not show it, since something nearer hides it.
        """
        shift = _shift(self.camera, eye)
        columns, rows, there = _shifted(self.camera, self.disparity, shift)
        disparity = _closed(self._nearest(columns, rows, there))
        columns, rows, here = _shifted(self.camera, disparity, -shift)
        shown = cv2.remap(
            self.disparity, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE
        )
        hidden = np.abs(shown - here) * self._pixels(shift) > _APART_PX
        return (columns, rows), np.asarray(hidden)

    def _pixels(self, shift: Float64) -> float:
        """Pixels by which a disparity shifts [px scene unit]."""
        return float(self.camera.fx * np.abs(shift).max())

    def _nearest(self, columns: Float32, rows: Float32, disparity: Float32) -> Float32:
        """Largest disparity of what falls on each pixel (h, w), 0 where nothing does."""
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


def _closed(disparity: Float32) -> Float32:
    """What nothing fell on is as far as the farthest beside it."""
    far = np.float32(1e9)
    filled = np.where(disparity < 0.0, far, disparity)
    while (empty := filled >= far).any():
        if empty.all():
            return np.zeros_like(disparity)
        filled = np.where(empty, cv2.erode(filled, np.ones((3, 3), np.uint8)), filled)
    return np.asarray(filled, np.float32)


def _shift(camera: Camera, eye: Float64) -> Float64:
    """From another place to a camera's (3,), right, up and back of that camera [scene unit]."""
    pose = camera.world_from_camera
    return np.asarray(pose[:3, :3].T @ (pose[:3, 3] - eye))


def _shifted(
    camera: Camera, disparity: Float32, shift: Float64
) -> tuple[Float32, Float32, Float32]:
    """Columns and rows (h, w) of a camera's pixels from elsewhere, and their disparity there."""
    right, up, back = (np.float32(one) for one in shift)
    x = ((np.arange(camera.width) + 0.5 - camera.cx) / camera.fx).astype(np.float32)[None, :]
    y = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy).astype(np.float32)[:, None]
    away = np.maximum(np.float32(1.0) - disparity * back, np.float32(1e-3))
    half = np.float32(0.5)
    columns = (x + disparity * right) / away * np.float32(camera.fx) + np.float32(camera.cx) - half
    rows = (y - disparity * up) / away * np.float32(camera.fy) + np.float32(camera.cy) - half
    return columns, rows, disparity / away


@dataclass(slots=True)
class Views:
    """Pictures of a shot that were turned to look the same way, evenly spaced, however many."""

    _kept: Reservoir = field(default_factory=lambda: Reservoir(most=_MOST_VIEWS))
    _eyes: list[Float64] = field(default_factory=list)

    def add(self, roots: Float32, eye: Float64) -> None:
        """Take the next picture.

        Args:
            roots: of its light (h, w, 3); NaN beyond it.
            eye: where its camera stood (3,) [scene unit].
        """
        if self._kept.takes_next:
            self._eyes.append(eye)
        self._kept.add(roots)
        if len(self._eyes) > self._kept.most:
            del self._eyes[1::2]

    @property
    def middle(self) -> Float64:
        """The place (3,) from which one of them was taken and from which the others are nearest."""
        eyes = np.array(self._eyes)
        away = np.linalg.norm(eyes - 0.5 * (eyes.min(axis=0) + eyes.max(axis=0)), axis=1)
        return self._eyes[int(np.argmin(away))]

    def disparity(self, camera: Camera, contact: Float64) -> Float32:
        """1 / depth of their background (h, w) [1 / scene unit].

        Args:
            camera: whose pixels are wanted.
            contact: where the object stands on the ground (3,).
        """
        away = -float(camera.to_camera(contact[None])[0, 2])
        nearest = 1.0 / max(away, 1e-6)
        return learn_disparity(self._kept.pictures, self._eyes, camera, float(contact[1]), nearest)


def learn_disparity(
    pictures: Sequence[Codes], eyes: Sequence[Float64], camera: Camera, ground_y: float,
    nearest: float,
) -> Float32:  # fmt: skip
    """1 / depth (h, w) of what pictures show that were turned to look the same way [1 / unit].

    Args:
        pictures: 16383 times the roots of light (h, w, 3); 65535 beyond a picture.
        eyes: where the camera of each stood (3,) [scene unit].
        camera: whose pixels are wanted; one of them.
        ground_y: height of the ground [scene unit].
        nearest: largest disparity that matters [1 / scene unit].
    """
    shifts = [_shift(camera, eye) for eye in eyes]
    reach = camera.fx * max(float(np.abs(one).max()) for one in shifts)
    most = _NEAREST * nearest
    count = min(_MOST_DEPTHS, max(2, math.ceil(most * reach / _STEP_PX) + 1))
    ground = np.maximum(camera.plane_disparity(ground_y), 0.0).astype(np.float32)
    guide = _guide(pictures, eyes, camera)
    tolerance = np.float32(0.5 * most / (count - 1))
    depths = [np.full(ground.shape, one, np.float32) for one in np.linspace(0.0, most, count)]
    found = ground.copy()
    best = _spread(pictures, shifts, camera, ground, guide)
    best *= np.float32(_FLAT)
    for depth in depths:
        cost = _spread(pictures, shifts, camera, depth, guide)
        better = (cost < best) & (depth > ground + tolerance)
        found[better] = depth[better]
        best[better] = cost[better]
    return np.asarray(cv2.medianBlur(found, 5), np.float32)


def _guide(pictures: Sequence[Codes], eyes: Sequence[Float64], camera: Camera) -> Float32:
    """The picture from nearest by, whose edges are those of surfaces."""
    away = [float(np.linalg.norm(eye - camera.world_from_camera[:3, 3])) for eye in eyes]
    codes = pictures[int(np.argmin(away))]
    return np.where(codes == _HIDDEN, np.uint16(0), codes).astype(np.float32) / np.float32(_CODES)


def _spread(
    pictures: Sequence[Codes], shifts: Sequence[Float64], camera: Camera, disparity: Float32,
    guide: Float32,
) -> Float32:  # fmt: skip
    """How far pictures that are laid at a disparity lie off their median (h, w) [1]."""
    low = np.ones(disparity.shape, np.bool_)
    laid: list[tuple[Codes, Bool]] = []
    for codes, shift in zip(pictures, shifts, strict=True):
        columns, rows, _ = _shifted(camera, disparity, shift)
        one = np.asarray(
            cv2.remap(
                codes, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT,
                borderValue=(65535, 65535, 65535),
            ),
            np.uint16,
        )  # fmt: skip
        hidden = one[..., 0] > 4 * _CODES
        one[hidden & low] = 0  # these leave the median as it is
        one[hidden & ~low] = _HIDDEN
        low ^= hidden
        laid.append((one, hidden))
    median = middle([one for one, _ in laid])
    limit = np.uint16(_MOST_OFF * _CODES)
    unseen = np.uint16(_UNSEEN * limit)  # else a depth is best at which few pictures are compared
    total = np.zeros(disparity.shape, np.float32)
    for one, hidden in laid:
        off = np.minimum(largest(np.maximum(one, median) - np.minimum(one, median)), limit)
        total += np.where(hidden, unseen, off)
    total /= np.float32(len(laid) * _CODES)
    return np.asarray(cv2.ximgproc.guidedFilter(guide, total, _WINDOW, _SMOOTHEST), np.float32)
