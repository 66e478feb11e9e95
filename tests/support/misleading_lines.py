"""A tiled ground under lines that lead a solve astray, such as stripes painted on a wall."""

import json

import cv2
import numpy as np
from support.camera_paths import rotation
from support.grounds import HEIGHT, WIDTH, view

PITCH_DEG = -20.0
LINES = tuple((0.03 + 0.06 * k, 0.02, 0.03 + 0.06 * k + 0.048 * (k - 3), 0.98) for k in range(14))
"""Their ends, x0, y0, x1, y1 [frame width, frame height]."""


def plate(lines=LINES):
    """The picture of a camera that looks down on tiles (H, W, 3)."""
    rows, columns = np.mgrid[0:2048, 0:2048] // 64
    tiles = np.repeat((((rows + columns) % 2) * 120 + 60)[..., None], 3, axis=2).astype(np.uint8)
    turn = rotation(np.radians(25.0), np.radians(PITCH_DEG), 0.0)
    seen = np.ascontiguousarray(view(tiles, turn, np.array((0.0, 1.5, 0.0))))
    for x0, y0, x1, y1 in lines:
        ends = [(round(x * WIDTH), round(y * HEIGHT)) for x, y in ((x0, y0), (x1, y1))]
        cv2.line(seen, *ends, (10, 10, 10), 3, cv2.LINE_AA)
    return seen


def angles_deg(camera):
    """Pitch, roll and field of view of the first frame of a `camera.json`."""
    first = json.loads(camera.read_text())["frames"][0]
    right, up, back = np.array(first["world_to_camera"])[:3, 1]
    return -np.degrees(np.arcsin(back)), np.degrees(np.arctan2(right, up)), first["fov_x_deg"]
