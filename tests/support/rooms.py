"""A room by rays: textured ground and wall, a card that stands before it, another that walks."""

from __future__ import annotations

import numpy as np

from nlens_video.core.color import ColorTags
from nlens_video.video.pixels.picture import ArrayPicture

LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)
WALL, CARD = -5.0, -3.2  # along z
_CARD = (0.5, 0.9, 1.0)  # its left, right and upper side
_RED = np.array([0.6, 0.03, 0.04])


def _rays(view):
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    rays = np.stack([(x - view.cx) / view.fx, (view.cy - y) / view.fy, -np.ones_like(x)], axis=-1)
    return rays @ view.world_from_camera[:3, :3].T


def _standing(view, rays, z, sides):
    """Disparity (H, W) and points of a card, 0 beside it."""
    eye = view.world_from_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        disparity = rays[..., 2] / (z - eye[2])
        points = eye + rays / np.maximum(disparity, 1e-9)[..., None]
    left, right, top = sides
    inside = (points[..., 0] > left) & (points[..., 0] < right) & (points[..., 1] < top)
    inside &= (points[..., 1] > 0.0) & (disparity > 0.0)
    return np.where(inside, disparity, 0.0), points


def room_disparities(view):
    """1 / depth of the ground, the wall and the card (3, H, W), 0 where a ray misses them."""
    rays = _rays(view)
    ground = np.maximum(-rays[..., 1] / view.world_from_camera[1, 3], 0.0)
    wall, _ = _standing(view, rays, WALL, (-1e9, 1e9, 1e9))
    card, _ = _standing(view, rays, CARD, _CARD)
    return np.stack([ground, wall, card])


def _painted(points, seed):
    """Light of a texture by the point (H, W, 3)."""
    rng = np.random.default_rng(seed)
    light = np.full(points.shape, 0.3)
    for size in (2.0, 5.0, 11.0, 23.0):
        for _ in range(3):
            way = rng.normal(size=3) * size
            light += (
                0.05 * np.sin(points @ way + rng.uniform(0, 6))[..., None] * rng.uniform(0.5, 1, 3)
            )
    return np.clip(light, 0.02, 1.0)


def room(view, walker=None, grain=0):
    """The picture of a camera.

    Args:
        view: it.
        walker: where along x, and at which distance, a red card stands that walks.
        grain: seed of a little noise, 0 for none.
    """
    rays, eye = _rays(view), view.world_from_camera[:3, 3]
    each = room_disparities(view)
    nearest = np.max(each, axis=0)
    points = eye + rays / np.maximum(nearest, 1e-9)[..., None]
    light = np.choose(
        np.argmax(each, axis=0)[..., None], [_painted(points, seed) for seed in (1, 2, 3)]
    )
    if walker is not None:
        x, away = walker
        seen, _ = _standing(view, rays, -away, (x - 0.1, x + 0.1, 0.8))
        light[seen > nearest] = _RED
    if grain:
        light = np.square(
            np.sqrt(light) + np.random.default_rng(grain).normal(0, 0.004, light.shape)
        )
    return ArrayPicture(light.astype(np.float32), "rgb", LINEAR)
