"""What the page draws the shadow of an object by while the sun is moved, ahead of the picture."""

from __future__ import annotations

import itertools

import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Float64
from nlens_video.scene.camera import Camera
from nlens_video.scene.plate_sun import level_axes

_SIDES = np.array([way for way in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(way)])


class ShadowGuides(Struct, frozen=True, kw_only=True):
    """An object in axes from its foot: to the right of the shot's first view, up, and ahead.

    Attributes:
        seen: matrix (3, 4), row by row, from such a point with a 1 as fourth number to its column
            and row in the frame and their divisor; the divisor is negative behind the camera
            [frame width, frame height].
        body: points of the object, farthest out each way; the highest has a height of 1.
    """

    seen: tuple[tuple[float, ...], ...]
    body: tuple[tuple[float, float, float], ...]


def shadow_guides(
    camera: Camera, first: Camera, foot: Float64, vertices: Float64
) -> ShadowGuides | None:
    """An object as its shadow is drawn, None where it has no height above its foot.

    Args:
        camera: of the frame.
        first: of the shot's first frame.
        foot: where the object touches the ground (3,) [scene unit].
        vertices: the object's (V, 3) [scene unit].
    """
    tall = float(vertices[:, 1].max() - foot[1])
    if not tall > 0.0:
        return None
    axes = tall * np.stack(level_axes(first), axis=1)
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = axes, foot
    points = (np.linalg.inv(camera.world_from_camera) @ world)[:3]
    x, y, away = points[0], points[1], -points[2]
    seen = np.stack([
        (camera.fx * x + camera.cx * away) / camera.width,
        (camera.cy * away - camera.fy * y) / camera.height,
        away,
    ])  # fmt: skip
    own = (vertices - foot) @ np.linalg.inv(axes).T
    body = own[np.unique((own @ _SIDES.T).argmax(axis=0))]
    return ShadowGuides(
        seen=tuple(map(tuple, seen.tolist())), body=tuple(map(tuple, body.round(4).tolist()))
    )
