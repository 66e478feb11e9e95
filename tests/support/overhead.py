"""A camera over the ground that looks down, under which shadows can be worked out by hand."""

import numpy as np

from nlens_video.scene.camera import Camera

WIDTH, HEIGHT = 160, 120


def looking_down(height=10.0, aside=0.0):
    """Over the origin or beside it; the picture's top is -Z, a unit of the ground is 20 px."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    pose[:2, 3] = aside, height
    return Camera(
        world_from_camera=pose, fx=20 * height, fy=20 * height, cx=WIDTH / 2, cy=HEIGHT / 2,
        width=WIDTH, height=HEIGHT,
    )  # fmt: skip
